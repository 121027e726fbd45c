"""Marks: files that pilots touch while they are there, whatever a batch system says of them."""

import os
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

#: A pilot touches its mark every so many seconds.
TOUCH_SECONDS = 10
#: A mark that nobody touches for so many seconds is that of a pilot that was killed. Files of a
#: network may be seen a minute late.
STALE_SECONDS = 90.0


@dataclass(kw_only=True)
class Marks:
    """The marks of a folder, by name; whoever has the folder reads them again and again.

    What a file says of its time is compared with itself only: clocks of machines differ.
    """

    folder: Path
    #: When a mark was last touched by its own account, and when that was seen, in seconds.
    _seen: dict[str, tuple[int, float]] = field(default_factory=dict)
    _gone: set[str] = field(default_factory=set)
    #: Whose marks somebody removed with the folder; their pilots make them again.
    _removed: set[str] = field(default_factory=set)

    def make(self) -> None:
        """Make the folder if it is not there; OSError if that cannot be."""
        if not self.folder.is_dir():
            self.folder.mkdir()
            self._removed |= self._seen.keys()

    def look(self, now: float) -> None:
        """Read the marks; a folder that is away says nothing.

        Args:
            now: seconds of a monotonic clock, as everywhere here.
        """
        try:
            names = [path.name for path in self.folder.iterdir()]
        except OSError:
            return
        self._removed -= set(names)
        for name in self._seen.keys() - set(names) - self._removed:
            del self._seen[name]
            self._gone.add(name)
        for name in names:
            try:
                # Opened, since a network's folder may be remembered as it was.
                with (self.folder / name).open() as file:
                    touched = os.fstat(file.fileno()).st_mtime_ns
            except OSError:
                continue
            before = self._seen.get(name)
            if before is None or before[0] != touched:
                self._seen[name] = touched, now
            self._gone.discard(name)

    def fresh(self, now: float) -> set[str]:
        """Return whose pilots are there, as far as is known at `now`."""
        return {name for name, (_, at) in self._seen.items() if now - at < STALE_SECONDS}

    def left(self, name: str) -> bool:
        """Say whether a pilot was there and has taken its mark away."""
        return name in self._gone

    def remove(self, name: str) -> None:
        """Forget a pilot; if it is there after all, it touches its mark again."""
        self._gone.discard(name)
        self._removed.discard(name)
        self._seen.pop(name, None)
        (self.folder / name).unlink(missing_ok=True)

    def clear_stale(self, now: float, known: Collection[str]) -> None:
        """Remove what killed pilots left, but for the `known` ones."""
        for name in self._seen.keys() - self.fresh(now) - set(known):
            self.remove(name)
        self._gone &= set(known)
