"""The commands about a study's precision goal: `study watch`, and what `submit` does after."""

import sys
import time
from collections.abc import Callable
from typing import Annotated

import typer

from rehyb.cli.answers import Answer, Token, Url, answering
from rehyb.cli.options import Output, StudyId, Target, check_target, optional
from rehyb.cli.study.size import Yes, check_rows
from rehyb.client import Client, Json
from rehyb.client.studies import ANALYSIS_SECONDS


@answering
def watch(
    as_json: bool,
    study: StudyId,
    up_to: Annotated[
        int | None, optional(min=1, help="Rows it may have in all. Default: the goal that it has.")
    ] = None,
    target: Target = None,
    output: Output = None,
    yes: Yes = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Have a study extended until its indices are precise enough, and wait for it.

    Ctrl-C loses nothing: the study goes on by itself. Exit status 1 if the cap came first.
    """
    if up_to is None and (target is not None or output is not None):
        raise typer.BadParameter("--target and --output need --up-to, the rows that it may cost")
    check_target(target)
    with Client(url, token) as client:
        if up_to is not None:
            check_rows(client, study, up_to, yes)
            client.set_precision_goal(study, up_to, target, output)
        answer = wait_for_precision(client, study, as_json=as_json)
    return Answer(answer, status=0 if answer["reached"] else 1)


def wait_for_precision(
    client: Client, study: str, *, as_json: bool, clock: Callable[[], float] = time.monotonic
) -> Json:
    """Wait for a study with a goal, saying what is decided; returns its goal, rows and id.

    If nothing is decided within `ANALYSIS_SECONDS` of `clock` though all results are in, it is said
    who would decide.
    """
    from analysis.reports.wording import START_ONE
    from rehyb.display import progress_in_words

    last, rows, since = "", 0, clock()

    def on_progress(progress: Json) -> None:
        nonlocal last, rows, since
        line = progress_in_words(progress)
        if progress["state"] != "complete" or progress["rows"] != rows:
            rows, since = progress["rows"], clock()
        elif clock() > since + ANALYSIS_SECONDS and not progress.get("left_by_analysis"):
            line += f"; its precision waits for an analysis: {START_ONE}"
        if line != last:
            print(line, file=sys.stderr, flush=True)
        last = line

    stream = sys.stderr if as_json else sys.stdout
    goal = client.wait_for_precision(
        study,
        on_progress=on_progress,
        on_step=lambda sentence: print(sentence, file=stream, flush=True),
    )
    return {**goal, "study": study}
