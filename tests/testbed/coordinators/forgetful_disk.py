"""A disk that forgets, keeps or tears what was written and not synced, in whatever order."""

import random
from collections import defaultdict
from pathlib import Path
from typing import Any

import apsw

SECTOR = 512


class Disk:
    """What SQLite has written to each file, and what of it is certain to be there afterwards."""

    def __init__(self) -> None:
        self._synced: dict[str, bytearray] = {}
        #: (offset, data), or (size, None) where a file was cut off.
        self._waiting: dict[str, list[tuple[int, bytes | None]]] = defaultdict(list)

    def holds(self, path: Path) -> None:
        """Take over a file as it is, all of it synced."""
        self._synced[str(path)] = bytearray(path.read_bytes())

    def write(self, path: str, offset: int, data: bytes | None) -> None:
        self._waiting[path].append((offset, data))

    def sync(self, path: str) -> None:
        content = self._synced.setdefault(path, bytearray())
        for offset, data in self._waiting.pop(path, []):
            _apply(content, offset, data)

    def delete(self, path: str) -> None:
        self._synced.pop(path, None)
        self._waiting.pop(path, None)

    def after_power_loss(self, folder: Path, rng: random.Random | None) -> None:
        """Write the files that are found afterwards to `folder`.

        What waits is all forgotten, or, with `rng`, each write is kept, torn or forgotten.
        """
        for path in {*self._synced, *self._waiting}:
            content = bytearray(self._synced.get(path, b""))
            for offset, data in self._waiting.get(path, []):
                fate = "forgotten" if rng is None else rng.choice(("kept", "torn", "forgotten"))
                if fate == "torn" and data is not None:
                    assert rng is not None
                    data = data[: rng.randrange(len(data) // SECTOR + 1) * SECTOR]
                if fate != "forgotten":
                    _apply(content, offset, data)
            (folder / Path(path).name).write_bytes(content)


def _apply(content: bytearray, offset: int, data: bytes | None) -> None:
    if data is None:
        del content[offset:]
        return
    if len(content) < offset:
        content.extend(bytes(offset - len(content)))
    content[offset : offset + len(data)] = data


class ForgetfulVFS(apsw.VFS):
    """SQLite's own file system, watched by a `Disk`."""

    def __init__(self, name: str, disk: Disk) -> None:
        self.disk = disk
        super().__init__(name, "")

    def xOpen(self, name: Any, flags: list[int]) -> Any:  # noqa: N802
        return _File(name, flags, self.disk)

    def xDelete(self, filename: str, syncdir: bool) -> None:  # noqa: N802
        self.disk.delete(filename)
        super().xDelete(filename, syncdir)


class _File(apsw.VFSFile):
    def __init__(self, name: Any, flags: list[int], disk: Disk) -> None:
        super().__init__("", name, flags)
        self.disk = disk
        self.path = name.filename() if isinstance(name, apsw.URIFilename) else str(name)

    def xWrite(self, data: bytes, offset: int) -> None:  # noqa: N802
        self.disk.write(self.path, offset, bytes(data))
        super().xWrite(data, offset)

    def xTruncate(self, newsize: int) -> None:  # noqa: N802
        self.disk.write(self.path, newsize, None)
        super().xTruncate(newsize)

    def xSync(self, flags: int) -> None:  # noqa: N802
        self.disk.sync(self.path)
        super().xSync(flags)
