"""A worker in which now and then an instance segfaults or hangs: `python saboteur.py`."""

import os
import random
import signal
import time
from collections.abc import Mapping
from functools import partial

from sim.evaluation import Evaluation
from sim.evaluation import evaluate as soundly
from worker import cli
from worker.pool import Pool

#: Rare enough that no instance meets it three times, which would be its final result.
CRASHES, HANGS = 0.006, 0.004


def evaluate(model: str, parameters: Mapping[str, float]) -> Evaluation:
    """Evaluate, or do not."""
    chance = random.random()
    if chance < CRASHES:
        os.kill(os.getpid(), signal.SIGSEGV)
    if chance < CRASHES + HANGS:
        time.sleep(3600)
    return soundly(model, parameters)


if __name__ == "__main__":
    cli.Pool = partial(Pool, evaluate=evaluate)  # type: ignore[assignment, misc]
    cli.main()
