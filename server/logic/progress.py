"""How far a study is, how fast it goes and when it will be done."""

from dataclasses import dataclass

from server.logic.study import Study

#: The rate is taken over this many results: enough to be calm, few enough to follow the fleet.
RATE_WINDOW = 500


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Speed of a study."""

    results_per_second: float
    #: Seconds until the last result; None if it cannot be told, 0 if nothing is left to do.
    eta_seconds: float | None
    elapsed_seconds: float


def window_start(result_count: int) -> int:
    """Return the number of the result from whose arrival on the rate is counted; 0: the start."""
    return max(0, result_count - RATE_WINDOW)


def pace(study: Study, *, window_opened_at: float, now: float) -> Pace:
    """Return how fast results come.

    Args:
        study: with its counters.
        window_opened_at: when result number `window_start(study.result_count)` arrived, or when
            the study was created if that is 0.
        now: seconds, UTC epoch. While the study runs, silence therefore lowers the rate.
    """
    if study.finished_at is not None:
        elapsed = study.finished_at - study.created_at
        rate = study.result_count / elapsed if elapsed > 0.0 else 0.0
        return Pace(results_per_second=rate, eta_seconds=0.0, elapsed_seconds=elapsed)
    counted = study.result_count - window_start(study.result_count)
    since = now - window_opened_at
    rate = counted / since if since > 0.0 else 0.0
    left = study.plan.instances - study.result_count
    return Pace(
        results_per_second=rate,
        eta_seconds=left / rate if rate > 0.0 else None,
        elapsed_seconds=max(0.0, now - study.created_at),
    )
