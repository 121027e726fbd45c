"""Tie a process to its parent, so that a killed parent leaves nothing behind."""

import ctypes
import os
import signal
import sys

# <linux/prctl.h>
PR_SET_PDEATHSIG = 1

# Looked up before any fork: between fork and exec a process should do as little as possible.
_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


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
