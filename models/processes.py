"""The processes that a process starts: what runs in them, which they are, to end them (Linux)."""

import ctypes
import os
import signal
import sys
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

# <linux/prctl.h>
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36

# Looked up before any fork: between fork and exec a process should do as little as possible.
_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


def python(*arguments: str) -> list[str]:
    """Return the command that runs modules of ours in another process.

    Python would first look for them in the folder that it runs in, where a models.py of the user's
    own may be; -P leaves that out, unless ours are there.
    """
    here = Path.cwd() in Path(__file__).parents
    return [sys.executable, *([] if here else ["-P"]), *arguments]


def die_with_parent(parent: int, signal_number: signal.Signals) -> None:
    """Have the kernel send `signal_number` to this process when process `parent` is gone.

    Does nothing where the kernel is not Linux.
    """
    if _libc is None:
        return
    _libc.prctl(PR_SET_PDEATHSIG, signal_number)
    # The parent may have died before the kernel was asked.
    if os.getppid() != parent:
        os.kill(os.getpid(), signal_number)


class _Adopting:
    """Whether this process takes over what its children leave behind."""

    on = False


def adopt_orphans() -> None:
    """Become the parent of what this process's children leave behind, however they detach it."""
    if _libc is not None:
        _libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        _Adopting.on = True


def orphans(but: Collection[int]) -> list[int]:
    """Return what was left to this process, with what that started.

    Args:
        but: programs of this process that still run. What has its session is its own, too.
    """
    if not _Adopting.on:
        return []
    found = []
    for pid in children(os.getpid()):
        with suppress(ProcessLookupError):
            if pid not in but and os.getsid(pid) != os.getsid(0):
                found += [pid, *descendants(pid)]
    return found


def children(pid: int) -> list[int]:
    """Return the processes that a process started, or took over; none if it has ended."""
    found: list[int] = []
    # It may end at any moment, as may any of its threads.
    with suppress(OSError), os.scandir(f"/proc/{pid}/task") as threads:
        for thread in threads:
            with suppress(OSError):
                found += map(int, Path(thread.path, "children").read_text().split())
    return found


def descendants(pid: int) -> list[int]:
    """Return the processes that a process started, and those that these started."""
    found = children(pid)
    return found + [below for child in found for below in descendants(child)]


def end(pids: list[int]) -> None:
    """Kill processes, and bury those that are this process's own children."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    for pid in pids:
        with suppress(ChildProcessError):
            os.waitpid(pid, 0)


def memory_of(pids: list[int]) -> int:
    """Return the bytes of memory that processes take together; what they share counts once."""
    return sum(_proportional(pid) for pid in pids)


def _proportional(pid: int) -> int:
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024
    except OSError:
        # It has ended, or is not ours.
        pass
    return 0
