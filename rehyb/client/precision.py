"""See a study through: until it is complete, and as precise as it is to be."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rehyb.client import Client, Json
from rehyb.errors import Conflict, Invalid

if TYPE_CHECKING:
    from analysis.sensitivity.stopping import Goal, Step

POLL_SECONDS = 1.0


def watch(
    client: Client,
    study_id: str,
    *,
    on_progress: Callable[[Json], None] = lambda progress: None,
    on_step: Callable[[str], None] = lambda sentence: None,
) -> Json:
    """Wait until a study with a goal (`Client.aim`) is extended no more.

    It only looks: interrupted, the study goes on, and the same call goes on telling.

    Args:
        client: the coordinator, which must have workers and an analysis.
        study_id: which study.
        on_progress: called about once a second.
        on_step: called with the sentence of every decision, those of before included.

    Returns:
        The study's "precision" as it is at the end, with "rows".

    Raises:
        Conflict: the study was cancelled.
        Invalid: it has no goal.
    """
    told = 0
    while True:
        progress = client.progress(study_id)
        on_progress(progress)
        goal = progress["precision"]
        if goal is None:
            raise Invalid(f"study {study_id} has no precision to reach: say one with --up-to")
        # A goal that was set anew begins anew.
        told = min(told, len(goal["steps"]))
        for step in goal["steps"][told:]:
            on_step(step["sentence"])
            told += 1
        if progress["state"] == "cancelled":
            raise Conflict(f"study {study_id} was cancelled before it was precise enough")
        if goal["settled"]:
            return {**goal, "rows": progress["rows"]}
        time.sleep(POLL_SECONDS)


def decide(snapshot: Json, rows: int, goal: "Goal") -> "Step | None":
    """Return what a study with all results does next; None until the analysis has seen them all.

    Raises:
        Invalid: the study has no such output, or the goal is none.
    """
    from analysis.sensitivity.stopping import next_step

    try:
        return next_step(snapshot, goal, rows)
    except ValueError as error:
        raise Invalid(str(error)) from None
