"""What a user would take instead of a coordinator, doing the same: nothing, with stored results.

Each module sets one system up as its documentation recommends for many short tasks, fills its
queue, starts workers and watches how fast finished tasks come to be stored. What was stored
outlives its worker; a power cut may take the last moments with it, as with a coordinator on SQLite.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from benchmarks.measuring import Throughput

#: Worker processes of each system, as many as a coordinator has.
PROCESSES = 4


@dataclass(frozen=True, kw_only=True)
class Rival:
    """One system as it was measured."""

    #: With version and where it stores.
    name: str
    #: How many tasks a worker is given at once.
    batch: int
    throughput: Throughput
    #: What it does not do that the others do; empty if there is nothing.
    lacks: str = ""


@contextmanager
def processes(count: int, target: Callable[..., None], *arguments: Any) -> Iterator[list[int]]:
    """Call `target` in so many new processes until the block ends; yields their ids."""
    context = get_context("spawn")
    started = [context.Process(target=target, args=arguments) for _ in range(count)]
    for process in started:
        process.start()
    try:
        yield [process.pid or 0 for process in started]
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.join(10.0)
            if process.is_alive():
                process.kill()
                process.join()
