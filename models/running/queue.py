"""Evaluations asked for by several threads, run by one pool of child processes."""

import threading
from collections.abc import Mapping
from queue import Queue
from typing import Any, Self

from models.evaluation import Evaluation
from models.running.place import Place
from models.running.pool import Pool

#: Seconds between two looks of the thread that runs the pool for what is newly asked.
TICK_SECONDS = 0.01


class EvaluationQueue:
    """A pool that any thread may ask and that one thread runs.

    Args:
        processes: evaluations at once.
        seconds: that one may take.
    """

    def __init__(self, processes: int, seconds: float) -> None:
        self._pool = Pool(processes, seconds)
        self._asked: Queue[tuple[dict[str, Any], Queue[Mapping[str, Any]]]] = Queue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._pool.kill()

    def evaluate(
        self, model: str, place: Place | None, parameters: Mapping[str, float], seed: int = 1
    ) -> Evaluation:
        """Return the evaluation of a model at `parameters` (SI units), when a child is free."""
        answer: Queue[Mapping[str, Any]] = Queue()
        instance = {"id": model, "model": model, "parameters": parameters, "seed": seed}
        limit = None if place is None else place.child_seconds
        self._asked.put(({**instance, "place": place, "time_limit": limit}, answer))
        return Evaluation(**{n: said for n, said in answer.get().items() if n != "instance"})

    def _run(self) -> None:
        while not self._stop.is_set():
            while self._pool.free and not self._asked.empty():
                self._pool.start(*self._asked.get())
            for done in self._pool.wait(TICK_SECONDS):
                done.ticket.put(done.result)
