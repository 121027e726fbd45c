"""The commands about how precise a study is to be: `study watch`, and what `submit` does after."""

import sys
from typing import Annotated

import typer

from rehyb.cli.options import AsJson, Token, Url, print_json
from rehyb.client import Client, Json
from rehyb.client.precision import watch as see_through


def watch(
    study: Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")],
    up_to: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Rows it may have in all. Default: the goal that it has.",
            show_default=False,
        ),
    ] = None,
    target: Annotated[
        float | None,
        typer.Option(
            help="Half width wanted of every interval. Default: 0.02 of S and ST, a tenth of the "
            "largest μ*.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        str | None, typer.Option(help="Default: the study's first.", show_default=False)
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Have a study extended until its indices are precise enough, and wait for it.

    Ctrl-C loses nothing: the study goes on by itself. Exit status 1 if the cap came first.
    """
    if up_to is None and (target is not None or output is not None):
        raise typer.BadParameter("--target and --output need --up-to, the rows that it may cost")
    with Client(url, token) as client:
        if up_to is not None:
            client.aim(study, up_to, target, output)
        answer = to_precision(client, study, as_json=as_json)
    if as_json:
        print_json(answer)
    if not answer["reached"]:
        raise typer.Exit(1)


def to_precision(client: Client, study: str, *, as_json: bool) -> Json:
    """Wait for a study with a goal, saying what is decided; returns its goal, rows and id."""
    from rehyb.display import progress_in_words

    last = ""

    def on_progress(progress: Json) -> None:
        nonlocal last
        line = progress_in_words(progress)
        if line != last:
            print(line, file=sys.stderr, flush=True)
        last = line

    stream = sys.stderr if as_json else sys.stdout
    goal = see_through(
        client,
        study,
        on_progress=on_progress,
        on_step=lambda sentence: print(sentence, file=stream, flush=True),
    )
    return {**goal, "study": study}
