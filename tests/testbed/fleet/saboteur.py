"""A worker on a bad machine, in which chosen instances segfault and hang: `python saboteur.py`.

TROUBLE: a folder that remembers which instances have done so, since each does it once: what does it
three times has failed for good.
MACHINE: what its host calls itself. CLOCK_OFFSET: seconds by which its clock is wrong.
SMALL_DISK: the spool has room for a result or two.
"""

import json
import os
import signal
import socket
import sqlite3
import time
import zlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from models.evaluation import Evaluation
from models.running.place import evaluate as soundly
from models.running.pool import Pool
from worker import cli, machine, spool

#: One instance in so many.
CRASHES, HANGS = 101, 397
#: Long enough that a study is not over before everything has gone wrong.
SECONDS = 0.01


def evaluate(instance: Mapping[str, Any]) -> Evaluation:
    """Evaluate, or do not."""
    number = zlib.crc32(json.dumps(sorted(instance["parameters"].items())).encode())
    for trouble, one_in in (("crash", CRASHES), ("hang", HANGS)):
        mark = Path(os.environ["TROUBLE"]) / f"{trouble}-{number}"
        if number % one_in == 0 and not mark.exists():
            mark.touch()
            if trouble == "crash":
                os.kill(os.getpid(), signal.SIGSEGV)
            time.sleep(3600)
    time.sleep(SECONDS)
    return soundly(instance)


def small_disk(path: Path) -> sqlite3.Connection:
    """Open a spool on a disk with hardly any room."""
    if not path.exists():
        made = sqlite3.connect(path)
        made.execute("PRAGMA page_size = 512")
        made.execute("VACUUM")
        made.close()
    database = SOUND(path)
    # No fewer than there are: from now on, none can be added.
    database.execute("PRAGMA max_page_count = 1")
    return database


SOUND = spool._open

if __name__ == "__main__":
    right, offset = time.time, float(os.environ.get("CLOCK_OFFSET", "0"))
    time.time = lambda: right() + offset  # type: ignore[assignment]
    socket.gethostname = lambda: os.environ["MACHINE"]
    if "SMALL_DISK" in os.environ:
        spool._open = small_disk
    # Half of a worker's start, and all are on one machine.
    machine.canary = lambda: ("the same", 0.5, [])  # type: ignore[assignment]
    cli.Pool = partial(Pool, evaluate=evaluate)  # type: ignore[assignment, misc]
    cli.main()
