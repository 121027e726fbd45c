"""How much work a worker asks for."""

import pytest

from worker.leases import lease_size


@pytest.mark.parametrize(
    ("seconds_each", "processes", "size"),
    [
        # Before anything is known: one for each process.
        (None, 4, 4),
        (None, 16, 10),
        # Two seconds of work for every process, but never more than asked for.
        (0.0, 1, 10),
        (0.5, 1, 4),
        (0.5, 2, 8),
        (0.5, 4, 10),
        # Always something.
        (30.0, 1, 1),
        (1e300, 1, 1),
    ],
)
def test_a_worker_asks_for_two_seconds_of_work(
    seconds_each: float | None, processes: int, size: int
) -> None:
    assert lease_size(seconds_each, processes, batch=10) == size
