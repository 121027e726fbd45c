"""How many threads linear algebra takes, set before NumPy is loaded."""

import os

#: What NumPy's own OpenBLAS reads when it is loaded.
VARIABLE = "OPENBLAS_NUM_THREADS"


def limit_threads() -> None:
    """Let linear algebra take one thread of each process, unless the environment says otherwise.

    Its matrices are small, and a worker has a process for each core: on a busy machine of two cores
    learning a bank of 256 recordings took 48 s of processor time with two threads and 1.6 s with
    one (2026-11-22).
    """
    os.environ.setdefault(VARIABLE, "1")
