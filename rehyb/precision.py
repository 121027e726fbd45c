"""See a study through: until it is complete, and extend it until its indices are precise enough."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rehyb.client import Client, Json
from rehyb.errors import Conflict, Invalid

if TYPE_CHECKING:
    from analysis.stopping import Step

POLL_SECONDS = 1.0


@dataclass(frozen=True, kw_only=True)
class Goal:
    """How precise the indices of one output are to be, and what that may cost."""

    output: str
    #: Half width of every interval; None: 0.02 of S and ST, a tenth of the largest mu*.
    target: float | None
    #: The study is not extended beyond this many rows.
    most_rows: int


def watch(
    client: Client,
    study_id: str,
    goal: Goal,
    *,
    on_progress: Callable[[Json], None] = lambda progress: None,
    on_step: Callable[["Step"], None] = lambda step: None,
) -> "Step":
    """Wait until a study is complete, and extend it until its goal is reached or its cap is.

    It keeps nothing: after an interruption the same call goes on where the study stands.

    Args:
        client: the coordinator, which must have workers and an analysis.
        study_id: which study.
        goal: what for.
        on_progress: called about once a second.
        on_step: called with every decision.

    Returns:
        The last decision.

    Raises:
        Conflict: the study was cancelled.
        Invalid: it has no such output.
    """
    while True:
        progress = client.progress(study_id)
        on_progress(progress)
        if progress["state"] == "cancelled":
            raise Conflict(f"study {study_id} was cancelled before it was precise enough")
        if progress["state"] == "complete":
            step = decide(client.indices(study_id), progress["rows"], goal)
            if step is not None:
                on_step(step)
                if step.rows is None:
                    return step
                client.extend(study_id, step.rows)
        time.sleep(POLL_SECONDS)


def decide(snapshot: Json, rows: int, goal: Goal) -> "Step | None":
    """Return what a study with all results does next; None until the analysis has seen them all.

    Raises:
        Invalid: the study has no such output, or the goal is none.
    """
    from analysis.stopping import next_step

    if snapshot["rows_complete"] < rows:
        return None
    try:
        return next_step(snapshot, goal.output, target=goal.target, most_rows=goal.most_rows)
    except ValueError as error:
        raise Invalid(str(error)) from None
