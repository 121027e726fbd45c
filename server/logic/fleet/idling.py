"""When a worker without work should ask again: the more of them there are, the later."""

from collections import OrderedDict
from math import ceil

#: Workers without work ask so often in all, at most.
ASKS_A_SECOND = 50.0
#: No worker is told to wait for longer: so late the last of them notices that there is work. Well
#: under the time after which a silent worker is taken for gone.
LONGEST_SECONDS = 30


class Idle:
    """The workers that were last told that there is nothing to do.

    Each coordinator counts those who ask it. Behind a balancer everybody asks everyone sooner or
    later, so they count alike.
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
