"""How long to leave a coordinator alone that did not answer, or has no work.

Full jitter (Brooker, "Exponential Backoff And Jitter", AWS Architecture Blog, 2015): a thousand
workers that lose the same coordinator at the same moment must not all come back at the same moment.
"""

from random import Random

#: Upper end of the first wait, in seconds.
BASE_SECONDS = 0.5
#: Upper end of every wait, in seconds: a coordinator that is back is noticed within this time.
CAP_SECONDS = 10.0
#: A draining worker stays this long for a coordinator that is away.
FAREWELL_SECONDS = 10.0


def full_jitter(failures: int, rng: Random) -> float:
    """Return the seconds to wait after `failures` (>= 1) failed calls in a row.

    Uniform below a ceiling that doubles from BASE_SECONDS with each failure up to CAP_SECONDS.

    Raises:
        ValueError: `failures` is less than 1.
    """
    if failures < 1:
        raise ValueError(f"there is nothing to back off from after {failures} failures")
    # 2 ** 1000 overflows a float; the cap is reached long before.
    doublings = min(failures - 1, 16)
    return rng.uniform(0.0, min(CAP_SECONDS, BASE_SECONDS * 2.0**doublings))


def without_work(retry_after: float, rng: Random) -> float:
    """Return the seconds to wait when the coordinator has no work and names `retry_after`."""
    return retry_after * rng.uniform(0.5, 1.0)
