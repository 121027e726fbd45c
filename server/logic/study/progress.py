"""How far a study is, how fast it goes and when it will be done."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from statistics import mean, stdev

from server.records import Study
from server.states import StudyState

#: The rate is taken over this many results: enough to be calm, few enough to follow the fleet.
RATE_WINDOW = 500
#: The window is cut into so many blocks of equally many results: how much the times they took
#: differ says how far the rate can be trusted.
BLOCKS = 10
#: Student's t for a two-sided interval of 90 % with BLOCKS - 1 degrees of freedom.
STUDENT_T = 1.833
#: Seconds that an analysis may take over what is new; then it seems that none runs.
UNSEEN_SECONDS = 30.0


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Speed of a study."""

    results_per_second: float
    #: Seconds until the last result; None if it cannot be told, 0 if nothing is left to do.
    eta_seconds: float | None
    #: A prediction interval of 90 % for it, as far as the last results tell; None before there
    #: are enough.
    eta_low_seconds: float | None
    eta_high_seconds: float | None
    elapsed_seconds: float


def window_start(result_count: int) -> int:
    """Return the number of the result from whose arrival on the rate is counted; 0: the start."""
    return max(0, result_count - RATE_WINDOW)


def block_ends(result_count: int) -> list[int]:
    """Return the numbers of the results between the blocks, BLOCKS + 1 of them; none: too few.

    Number 0 stands for the start of the study.
    """
    size = (result_count - window_start(result_count)) // BLOCKS
    return [result_count - size * k for k in range(BLOCKS, -1, -1)] if size else []


def pace(
    study: Study,
    *,
    window_opened_at: float,
    now: float,
    passed_at: Sequence[float] = (),
    at_work: bool = True,
) -> Pace:
    """Return how fast results come.

    Args:
        window_opened_at: when result number `window_start(study.result_count)` arrived, or when
            the study was created if that is 0.
        now: seconds, UTC epoch. While the study runs, silence therefore lowers the rate.
        passed_at: when the results `block_ends(study.result_count)` arrived.
        at_work: whether anybody computes it; else nobody knows when it ends.
    """
    if study.finished_at is not None:
        elapsed = study.finished_at - study.created_at
        rate = study.result_count / elapsed if elapsed > 0.0 else 0.0
        return Pace(
            results_per_second=rate,
            eta_seconds=0.0,
            eta_low_seconds=0.0,
            eta_high_seconds=0.0,
            elapsed_seconds=elapsed,
        )
    counted = study.result_count - window_start(study.result_count)
    took, pause = _without_pause([after - before for before, after in pairwise(passed_at)])
    since = now - window_opened_at - pause
    rate = counted / since if since > 0.0 else 0.0
    left = study.plan.instances - study.result_count
    eta = left / rate if rate > 0.0 and at_work else None
    off = None if eta is None else _half_width(took, left * BLOCKS / counted)
    return Pace(
        results_per_second=rate,
        eta_seconds=eta,
        eta_low_seconds=None if eta is None or off is None else max(0.0, eta - off),
        eta_high_seconds=None if eta is None or off is None else eta + off,
        elapsed_seconds=max(0.0, now - study.created_at),
    )


def first_left(study: Study, *, cursor: int, rows_seen: int) -> int | None:
    """Return the number of a result at whose arrival the analysis had news; None: it has none.

    It may have had them before. While a study runs, results of incomplete rows are no news. Rows
    that it has not seen were completed by as many results: the first of them is among the last so
    many.

    Args:
        cursor: how many results the analysis has taken in.
        rows_seen: how many complete rows its snapshot has.
    """
    unseen = study.rows_complete - rows_seen
    if study.result_count <= cursor or (study.state == StudyState.RUNNING and unseen <= 0):
        return None
    return study.result_count + 1 - max(unseen, 1)


def _without_pause(took: list[float]) -> tuple[list[float], float]:
    """Return the blocks' seconds, and how long nobody was at work in the midst of them.

    A block that took longer than all others together holds a pause: machines were switched off, as
    before a campaign is resumed. Where results come in heaps, some blocks take no time, and a long
    one says nothing.
    """
    if len(took) != BLOCKS:
        return took, 0.0
    *others, longest = sorted(took)
    if not 0.0 < others[0] <= sum(others) < longest:
        return took, 0.0
    return others, longest - mean(others)


def _half_width(took: Sequence[float], blocks_left: float) -> float | None:
    """Return how far the time for the blocks to come may be off, in seconds; None: nobody knows.

    As if the blocks took times drawn independently from one normal distribution: the variance of
    what is left, and that of the mean it is foretold from.
    """
    spread = stdev(took) if took else 0.0
    if not spread > 0.0:
        # As when all came at once: that says nothing of those to come.
        return None
    return STUDENT_T * spread * sqrt(blocks_left + blocks_left**2 / BLOCKS)
