"""Results on disk until the coordinator has acknowledged them.

One SQLite file per running worker, held under SQLite's exclusive lock. The kernel drops the lock
when the worker dies, however it dies, so an unlocked file in the folder is an orphan: the next
worker that starts adopts what is in it.
"""

import json
import logging
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rehyb.errors import RehybError

log = logging.getLogger(__name__)

SUFFIX = ".spool"
#: Results sent in one request.
BATCH = 100


#: (lease, fence, worker, result as JSON)
_Row = tuple[str, int, str, str]


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Results to be posted together."""

    lease: str
    fence: int
    #: The worker that computed them: not this one if they were adopted.
    worker: str
    keys: tuple[int, ...]
    results: tuple[dict[str, Any], ...]


class Spool:
    """The results of one worker that nobody has acknowledged.

    Args:
        directory: shared by the workers of one machine for one coordinator; made if missing.
        worker: the worker's id, which names its file.

    Raises:
        RehybError: there can be no such folder, or no file in it.
    """

    def __init__(self, directory: Path, worker: str) -> None:
        self._worker = worker
        self._path = directory / f"{worker}{SUFFIX}"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._database = _open(self._path)
        except (OSError, sqlite3.OperationalError) as error:
            raise RehybError(no_place(directory, error)) from error
        #: What the disk did not take, under negative keys.
        self._overflow: dict[int, _Row] = {}
        #: Acknowledged, but still on disk.
        self._forgotten: set[int] = set()
        #: Not to be posted for now.
        self._aside: set[int] = set()

    def __len__(self) -> int:
        kept = int(self._database.execute("SELECT count(*) FROM results").fetchone()[0])
        return kept - len(self._forgotten) + len(self._overflow)

    def add(self, results: Sequence[tuple[str, int, Mapping[str, Any]]]) -> None:
        """Keep results, each (lease, fence, result); from here on they survive this process.

        If the disk is full they are kept in memory, and survive as long as this process does.
        """
        rows = [
            (lease, fence, self._worker, json.dumps(result)) for lease, fence, result in results
        ]
        try:
            self._insert(rows)
        except sqlite3.OperationalError as error:
            if not self._overflow:
                log.warning("%s: %s; results are kept in memory", self._path, error)
            first = min(self._overflow, default=0) - 1
            self._overflow |= {first - number: row for number, row in enumerate(rows)}

    def next_batch(self, limit: int = BATCH) -> Batch | None:
        """Return the oldest results that share a lease; None if there are none to post now."""
        left_out = json.dumps(sorted(self._forgotten | self._aside))
        oldest = self._database.execute(
            "SELECT key, lease, worker FROM results "
            "WHERE key NOT IN (SELECT value FROM json_each(?)) ORDER BY key LIMIT 1",
            (left_out,),
        ).fetchone()
        rows: list[tuple[int, str, int, str, str]] = []
        if oldest is not None:
            rows = self._database.execute(
                "SELECT key, lease, fence, worker, result FROM results "
                "WHERE key >= ? AND lease = ? AND worker = ? "
                "AND key NOT IN (SELECT value FROM json_each(?)) ORDER BY key LIMIT ?",
                (*oldest, left_out, limit),
            ).fetchall()
        if not rows:
            overflow = {k: row for k, row in self._overflow.items() if k not in self._aside}
            first = next(iter(overflow.values()), None)
            rows = [
                (key, *row)
                for key, row in overflow.items()
                if first is not None and row[:3] == first[:3]
            ][:limit]
        if not rows:
            return None
        _, lease, fence, worker, _ = rows[0]
        return Batch(
            lease=lease,
            fence=fence,
            worker=worker,
            keys=tuple(row[0] for row in rows),
            results=tuple(json.loads(row[4]) for row in rows),
        )

    def acknowledge(self, keys: Sequence[int]) -> None:
        """Forget the results under `keys`: the coordinator has them, or will never take them."""
        for key in keys:
            self._overflow.pop(key, None)
        # A full disk has no room for the journal of a deletion either: it is tried again next time.
        self._forgotten |= {key for key in keys if key > 0}
        with suppress(sqlite3.OperationalError), self._database:
            self._database.executemany(
                "DELETE FROM results WHERE key = ?", [(key,) for key in self._forgotten]
            )
            self._forgotten.clear()

    def set_aside(self, keys: Sequence[int]) -> None:
        """Leave the results under `keys` out of `next_batch`; they stay where they are."""
        self._aside |= set(keys)

    def bring_back(self) -> int:
        """Have `next_batch` return what was set aside; returns how many results that are."""
        count = len(self._aside)
        self._aside.clear()
        return count

    def adopt(self) -> int:
        """Take over the results that dead workers left in the folder; return how many."""
        adopted = 0
        for path in sorted(self._path.parent.glob(f"*{SUFFIX}")):
            if path == self._path:
                continue
            try:
                orphan = _open(path)
            except sqlite3.DatabaseError as error:
                # Locked: its worker lives. Anything else: a file that is no spool is not ours.
                if "locked" not in str(error):
                    log.warning("%s is not a spool: %s", path, error)
                continue
            rows = orphan.execute("SELECT lease, fence, worker, result FROM results").fetchall()
            try:
                self._insert(rows)
            except sqlite3.OperationalError as error:
                # It stays where it is until there is room.
                log.warning("%s cannot be adopted: %s", path, error)
                orphan.close()
                continue
            with orphan:
                orphan.execute("DELETE FROM results")
            orphan.close()
            path.unlink(missing_ok=True)
            adopted += len(rows)
        return adopted

    def close(self) -> None:
        """Close the file, and remove it if everything in it is acknowledged."""
        empty = len(self) == 0
        self._database.close()
        if empty:
            self._path.unlink(missing_ok=True)

    def _insert(self, rows: Iterable[tuple[str, int, str, str]]) -> None:
        with self._database:
            self._database.executemany(
                "INSERT INTO results (lease, fence, worker, result) VALUES (?, ?, ?, ?)", rows
            )


def no_place(directory: Path, error: Exception) -> str:
    """Say why results cannot wait in a folder, and what would be right."""
    why = getattr(error, "strerror", None) or error
    return (
        f"results cannot wait in {directory}: {why}; "
        "name with --spool a folder that is there or can be made"
    )


def _open(path: Path) -> sqlite3.Connection:
    """Open and lock a spool file; sqlite3.OperationalError at once if another process has it."""
    database = sqlite3.connect(path, timeout=0.0)
    try:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
        # The kernel keeps what was written when a process dies. A result lost to a power cut is
        # computed again after its lease expires, which is cheaper than a disk flush per result.
        database.execute("PRAGMA synchronous = OFF")
        database.execute("BEGIN EXCLUSIVE")
        database.execute(
            "CREATE TABLE IF NOT EXISTS results (key INTEGER PRIMARY KEY AUTOINCREMENT, "
            "lease TEXT NOT NULL, fence INTEGER NOT NULL, worker TEXT NOT NULL, "
            "result TEXT NOT NULL)"
        )
        database.commit()
    except sqlite3.DatabaseError:
        database.close()
        raise
    return database
