"""The command that sees a study through to a wanted precision: `study watch`."""

import sys
from dataclasses import asdict
from typing import Annotated

import typer

from rehyb.cli.options import AsJson, Token, Url, print_json
from rehyb.client import Client, Json
from rehyb.precision import Goal
from rehyb.precision import watch as see_through


def watch(
    study: Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")],
    up_to: Annotated[int, typer.Option(min=1, help="Rows it may have in all.")],
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
    """Extend a study until its indices are precise enough, or it has as many rows as allowed.

    Ctrl-C loses nothing: the same command goes on. Exit status 1 if the cap came first.
    """
    with Client(url, token) as client:
        answer = to_precision(client, client.study(study), target, up_to, output, as_json=as_json)
    if as_json:
        print_json(answer)
    if not answer["reached"]:
        raise typer.Exit(1)


def to_precision(
    client: Client,
    study: Json,
    target: float | None,
    up_to: int,
    output: str | None,
    *,
    as_json: bool,
) -> Json:
    """See a study through, saying what is decided; returns the last decision and the rows."""
    from rehyb.display import progress_in_words

    goal = Goal(output=output or study["outputs"][0], target=target, most_rows=up_to)
    last = ""

    def on_progress(progress: Json) -> None:
        nonlocal last
        line = progress_in_words(progress)
        if line != last:
            print(line, file=sys.stderr, flush=True)
        last = line

    stream = sys.stderr if as_json else sys.stdout
    step = see_through(
        client,
        study["id"],
        goal,
        on_progress=on_progress,
        on_step=lambda step: print(step.sentence, file=stream, flush=True),
    )
    return asdict(step) | {"rows": client.study(study["id"])["rows"], "study": study["id"]}
