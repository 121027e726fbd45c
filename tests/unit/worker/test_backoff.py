"""A worker leaves an absent coordinator alone, but not for long."""

from random import Random

import pytest

from worker.backoff import BASE_SECONDS, CAP_SECONDS, full_jitter


@pytest.mark.parametrize(
    ("failures", "ceiling"),
    [(1, BASE_SECONDS), (2, 2 * BASE_SECONDS), (4, 8 * BASE_SECONDS), (6, 10.0), (5000, 10.0)],
)
def test_a_wait_is_spread_over_everything_below_a_ceiling_that_doubles(
    failures: int, ceiling: float
) -> None:
    rng = Random(1)
    waits = [full_jitter(failures, rng) for _ in range(2000)]
    assert 0.0 <= min(waits) < 0.01 * ceiling
    assert 0.99 * ceiling < max(waits) <= ceiling
    assert sum(waits) / len(waits) == pytest.approx(ceiling / 2, rel=0.05)


def test_no_wait_is_longer_than_ten_seconds() -> None:
    assert CAP_SECONDS == 10.0


def test_the_same_generator_gives_the_same_waits() -> None:
    assert [full_jitter(3, Random(7)) for _ in range(3)] == [full_jitter(3, Random(7))] * 3


def test_there_is_nothing_to_wait_for_without_a_failure() -> None:
    with pytest.raises(ValueError, match="nothing to back off from"):
        full_jitter(0, Random(1))
