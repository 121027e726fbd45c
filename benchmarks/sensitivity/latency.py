"""How far the indices lag behind the results, while results arrive at a steady rate."""

import threading
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from analysis.designs import DEFAULT_SAMPLING
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import follow

#: Of the arm in the exoskeleton: six factors, and twelve outputs.
PLAN = StudyPlan(
    id="s",
    method="saltelli",
    seed=1,
    sampling=DEFAULT_SAMPLING,
    rows=4096,
    factors=tuple("abcdef"),
    outputs=tuple(f"y{o}" for o in range(12)),
)
WIDTH = 8


def results(number: int) -> list[LoggedResult]:
    """Return the first results of the study, in order, of normal numbers."""
    rng = np.random.default_rng(1)
    return [
        LoggedResult(
            seq=1 + i,
            instance="",
            row=i // WIDTH,
            position=i % WIDTH,
            outcome="ok",
            outputs=dict(zip(PLAN.outputs, rng.normal(size=12).tolist(), strict=True)),
        )
        for i in range(number)
    ]


@dataclass(kw_only=True)
class Arriving:
    """A log (`service.ResultLog`) in memory, whose results arrive at a steady rate."""

    results: list[LoggedResult]
    per_second: float
    begun: float = field(default_factory=time.perf_counter)
    cursor: int = 0
    state: bytes | None = None
    #: Seconds from the arrival of the oldest result of a commit to that commit.
    lags: list[float] = field(default_factory=list)

    def arrived(self) -> int:
        """Return how many results are there by now."""
        passed = (time.perf_counter() - self.begun) * self.per_second
        return min(int(passed), len(self.results))

    def alone(self) -> AbstractContextManager[bool]:
        return nullcontext(True)

    def studies_with_news(self) -> list[str]:
        return ["s"] if self.arrived() > self.cursor else []

    def plan(self, study_id: str) -> StudyPlan:
        return PLAN

    def load(self, study_id: str) -> tuple[int, bytes | None]:
        return self.cursor, self.state

    def results_after(self, study_id: str, cursor: int, limit: int) -> list[LoggedResult]:
        return self.results[cursor : min(self.arrived(), cursor + limit)]

    def commit(
        self,
        study_id: str,
        *,
        expected_cursor: int,
        cursor: int,
        state: bytes,
        snapshot: dict[str, Any],
    ) -> bool:
        arrived_at = self.begun + (self.cursor + 1) / self.per_second
        self.lags.append(time.perf_counter() - arrived_at)
        self.cursor, self.state = cursor, state
        return True

    def act_on_precision_goals(self) -> None:
        """Nothing: it has none."""


def lags(per_second: float = 500.0, seconds: float = 10.0) -> list[float]:
    """Return how long the oldest result of every commit had waited for it (s, wall clock)."""
    log = Arriving(results=results(int(per_second * seconds)), per_second=per_second)
    stop = threading.Event()
    thread = threading.Thread(target=follow, args=(log,), kwargs={"stop": stop})
    thread.start()
    while log.cursor < len(log.results):
        time.sleep(0.05)
    stop.set()
    thread.join()
    return log.lags
