"""When a worker without work should ask again: the more of them there are, the later."""

from collections import OrderedDict
from math import ceil

#: Workers without work ask a coordinator so often in all, at most.
ASKS_A_SECOND = 50.0
#: No worker is told to wait for longer: so late the last of them notices that there is work. Well
#: under the time after which a silent worker is taken for gone.
LONGEST_SECONDS = 30
#: The same of jobs on sessions: questions a second, and how long a worker may stay away.
JOB_ASKS_A_SECOND = 5
JOB_ASK_SECONDS = (2, 15)


class Idle:
    """The workers that were last told that there is nothing to do.

    Each coordinator counts those who ask it. Where everybody asks everyone sooner or later, all
    count alike; where a balancer divides the workers for good, each is asked as often as one alone.
    """

    def __init__(self) -> None:
        #: When each was told, the earliest first.
        self._told: OrderedDict[str, float] = OrderedDict()

    def __len__(self) -> int:
        return len(self._told)

    def tell(self, worker: str, now: float) -> int:
        """Return the whole seconds after which a worker without work should ask again."""
        self._told[worker] = now
        self._told.move_to_end(worker)
        # Who has not come back for so long is gone, or asks somebody else.
        while self._told[first := next(iter(self._told))] < now - 2 * LONGEST_SECONDS:
            del self._told[first]
        return min(LONGEST_SECONDS, max(1, ceil(len(self._told) / ASKS_A_SECOND)))

    def busy(self, worker: str) -> None:
        """Note that a worker has work again."""
        self._told.pop(worker, None)


def ask_for_jobs_in(workers: int) -> int:
    """Return the seconds after which one of so many workers without a job should ask again.

    The more there are, the less each has to: together they notice a new job soon enough.
    """
    low, high = JOB_ASK_SECONDS
    return min(max(low, ceil(workers / JOB_ASKS_A_SECOND)), high)
