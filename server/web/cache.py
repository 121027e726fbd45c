"""What every look at a page would otherwise work out again."""

from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class Cache(Generic[T]):
    """Answers by what they depend on; of more than `most`, the first found is dropped."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._found: dict[Hashable, T] = {}
        self._lock = Lock()

    def of(
        self, key: Hashable, find: Callable[[], T], stays: Callable[[T], bool] = lambda _: True
    ) -> T:
        """Return the answer to `key`, which `find` finds if it is not known; kept if it `stays`."""
        with self._lock:
            if key in self._found:
                return self._found[key]
        found = find()
        if not stays(found):
            return found
        with self._lock:
            self._found[key] = found
            while len(self._found) > self._most:
                del self._found[next(iter(self._found))]
        return found
