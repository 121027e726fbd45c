"""The analysis process: follows the logs of results and keeps every study's snapshot up to date.

Any number of these processes may run on one store. Each reads a study's log from the cursor the
last commit left, and commits state, snapshot and new cursor at once, provided that the cursor is
still where it found it and the study is as it was planned. So every result counts once, whoever is
first, and a process may die at any moment (docs/decisions/0004).
"""

import logging
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from threading import Event
from typing import Any, Protocol

from analysis.sensitivity.estimator_state import EstimatorState, StaleStateError
from analysis.sensitivity.records import LoggedResult, NoSuchStudyError, StudyPlan

__all__ = ["LoggedResult", "ResultLog", "StudyPlan", "analyse", "catch_up", "follow", "patiently"]

logger = logging.getLogger(__name__)

#: Says of an error why the store is away, in a sentence; None: it is not.
WhyAway = Callable[[Exception], str | None]
#: Seconds between two looks for news.
POLL_SECONDS = 0.5
#: The most of them between two looks for a store that is away.
LONGEST_PAUSE = 8.0
#: What a study's numbers may bring about in our code. The store's errors are of other kinds, and
#: not about one study.
_OF_A_STUDY = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    ImportError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
)
#: Results between two commits: few enough that a snapshot is never long in coming.
BATCH = 2000


class ResultLog(Protocol):
    """What the analysis needs of a store."""

    def alone(self) -> AbstractContextManager[bool]:
        """Say for a block whether no other process analyses; whoever is second may rest."""

    def studies_with_news(self) -> list[str]:
        """Return the studies whose log is longer than their cursor."""

    def plan(self, study_id: str) -> StudyPlan:
        """Return what a study set out to do; NoSuchStudyError if it is gone."""

    def load(self, study_id: str) -> tuple[int, bytes | None]:
        """Return the cursor and the state last committed; `(0, None)` if none was."""

    def results_after(self, study_id: str, cursor: int, limit: int) -> list[LoggedResult]:
        """Return up to `limit` results with seq > cursor, in order of seq.

        An empty list if there are none, or if the study has changed since `plan` was asked for:
        what is left is for the next call.
        """

    def commit(
        self,
        study_id: str,
        *,
        expected_cursor: int,
        cursor: int,
        state: bytes,
        snapshot: dict[str, Any],
    ) -> bool:
        """Replace cursor, state and snapshot at once.

        False if the cursor is not as expected, or the study has changed since `plan` was asked for.
        """

    def act_on_precision_goals(self) -> None:
        """Extend the complete studies that are less precise than their goals.

        The rule is `judgement.stopping.next_step`; studies whose snapshot lacks a result
        wait. One that cannot be judged is told so, and keeps no other from being judged.
        """


def catch_up(log: ResultLog, study_id: str) -> int:
    """Take in what a study's log has new, and return how many results were committed.

    Stops early if another process commits first: what is left is its business, or the next call's.
    """
    plan = log.plan(study_id)
    committed, data = log.load(study_id)
    state = _restore(plan, data)
    taken = 0
    while results := log.results_after(study_id, state.cursor, BATCH):
        new = state.take(results)
        if not log.commit(
            study_id,
            expected_cursor=committed,
            cursor=state.cursor,
            state=state.to_bytes(),
            snapshot=state.snapshot(),
        ):
            break
        committed = state.cursor
        taken += new
    return taken


def follow(
    log: ResultLog,
    *,
    stop: Event,
    poll_seconds: float = POLL_SECONDS,
    why_away: WhyAway = lambda error: None,
) -> None:
    """Keep every study caught up, and those with a goal growing, until `stop` is set.

    A store that is away is waited for, as `patiently` does. A study that cannot be computed is left
    alone until the process starts again: the others go on.
    """
    failed: set[str] = set()

    def look() -> bool:
        with log.alone() as mine:
            if mine:
                _look(log, stop, failed)
        return False

    patiently(look, stop=stop, why_away=why_away, poll_seconds=poll_seconds)


def patiently(
    act: Callable[[], bool], *, stop: Event, why_away: WhyAway, poll_seconds: float = POLL_SECONDS
) -> None:
    """Act again and again until it is done, says `act`, or `stop` is set.

    While the store is away the pauses grow. That it goes and that it is back is logged, once each;
    any other error is raised.
    """
    away, pause = False, poll_seconds
    while not stop.is_set():
        try:
            done = act()
        except Exception as error:
            if (why := why_away(error)) is None:
                raise
            if not away:
                logger.warning("the database is away, and waited for: %s", why)
            away, pause = True, min(2.0 * pause, LONGEST_PAUSE)
        else:
            if away:
                logger.warning("the database is back")
            away, pause = False, poll_seconds
            if done:
                return
        stop.wait(pause)


def _look(log: ResultLog, stop: Event, failed: set[str]) -> None:
    for study_id in log.studies_with_news():
        if stop.is_set():
            return
        if study_id in failed:
            continue
        try:
            # One that was deleted since it was listed needs no indices.
            with suppress(NoSuchStudyError):
                catch_up(log, study_id)
        except _OF_A_STUDY:
            failed.add(study_id)
            logger.exception(
                "study %s has no indices, an error of rehyb: please report it", study_id
            )
    log.act_on_precision_goals()


def analyse(plan: StudyPlan, results: Iterable[LoggedResult]) -> dict[str, Any]:
    """Return the snapshot of a study from its results at one go, in whatever order they come."""
    state = EstimatorState(plan)
    state.take(results)
    return state.snapshot()


def _restore(plan: StudyPlan, data: bytes | None) -> EstimatorState:
    if data is None:
        return EstimatorState(plan)
    try:
        return EstimatorState.from_bytes(plan, data)
    except StaleStateError:
        # Nothing is lost: the log has it all, and the first commit replaces the old state.
        return EstimatorState(plan)
