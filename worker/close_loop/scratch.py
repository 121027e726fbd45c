"""Folders for one job each, which go with their worker, however that ends."""

import fcntl
import re
import shutil
from contextlib import suppress
from pathlib import Path
from typing import IO


class Scratch:
    """A folder for one job; if its worker is killed, the next worker here removes it."""

    def __init__(self, folder: Path, name: str) -> None:
        self._path = folder / file_name(name)
        self._lock: IO[str] | None = None

    def __enter__(self) -> Path:
        while self._lock is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            # Unless another worker, which has no job any more, has removed the folder just now.
            with suppress(FileNotFoundError):
                self._lock = _lock_of(self._path).open("w")
        fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._path.mkdir()
        return self._path

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._path, ignore_errors=True)
        _lock_of(self._path).unlink(missing_ok=True)
        if self._lock is not None:
            self._lock.close()
        # Another worker may have a job.
        with suppress(OSError):
            self._path.parent.rmdir()


def sweep(folder: Path) -> None:
    """Remove what workers that were killed have left in `folder`."""
    for path in folder.iterdir() if folder.is_dir() else ():
        if not path.is_dir():
            continue
        with _lock_of(path).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            shutil.rmtree(path, ignore_errors=True)
            _lock_of(path).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def _lock_of(path: Path) -> Path:
    return path.with_name(path.name + ".lock")


def file_name(name: str) -> str:
    """Return a coordinator's word as the name of a file, and of nothing else."""
    return re.sub(r"[/\\\x00-\x1f]", "_", name)[:60].strip(".") or "session"
