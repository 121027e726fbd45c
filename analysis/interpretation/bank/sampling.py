"""Simulate wearers of a population, on the cores of this machine."""

import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from analysis.interpretation.bank.bank import KEPT, LEVELS, Samples
from analysis.interpretation.bank.population import Population
from models.evaluation import Evaluation
from models.processes import die_with_parent
from sim.evaluation import evaluate
from sim.parameters.conditions import CONTACT_ONLY

Progress = Callable[[int, int], None]

#: Wearers whom a process simulates before it says so.
_CHUNK = 16


def sample(
    population: Population,
    seed: int,
    rows: Sequence[int],
    *,
    level: str,
    processes: int = 1,
    progress: Progress = lambda done, total: None,
    changed: Mapping[str, float] | None = None,
) -> Samples:
    """Simulate wearers `rows` of `seed`; who fails is counted and left out.

    Args:
        population: whom they belong to.
        seed: of the population's draw.
        rows: their numbers.
        level: "bushing" or "contact".
        processes: at work at a time; 1 is this one.
        progress: called with how many are done and how many there are.
        changed: values of factors that replace what was drawn, for recordings unlike the bank.
    """
    factors = population.draw(seed, np.asarray(rows))
    jobs = [
        (LEVELS[level], parameters_of(population, values, level) | dict(changed or {}))
        for values in factors
    ]
    kept, outcomes = [], Counter[str]()
    for i, evaluation in enumerate(_evaluated(jobs, processes)):
        values = [evaluation.outputs.get(name, np.nan) for name in KEPT]
        believed = evaluation.outcome == "ok" and bool(np.isfinite(values).all())
        if believed:
            kept.append((i, values))
        else:
            outcomes[evaluation.outcome] += 1
        progress(i + 1, len(jobs))
    chosen = [i for i, _ in kept]
    return Samples(
        rows=np.asarray(rows, dtype=np.int64)[chosen],
        factors=factors[chosen],
        values=np.array([values for _, values in kept]).reshape(-1, len(KEPT)),
        failed=dict(sorted(outcomes.items())),
    )


def parameters_of(population: Population, values: np.ndarray, level: str) -> dict[str, float]:
    """Return a wearer's parameters at a level: what only contact has means nothing without it."""
    own = dict(population.fixed) | dict(zip(population.names, values.tolist(), strict=True))
    return own if level == "contact" else {n: v for n, v in own.items() if n not in CONTACT_ONLY}


def _evaluated(jobs: list[tuple[str, dict[str, float]]], processes: int) -> Iterator[Evaluation]:
    """Yield the evaluation of each job, in order."""
    if processes == 1:
        yield from map(_evaluate, jobs)
        return
    context = multiprocessing.get_context("spawn")
    # A killed parent tells nobody: its processes would wait for more for ever.
    end = (os.getpid(), signal.SIGKILL)
    with ProcessPoolExecutor(
        processes, mp_context=context, initializer=die_with_parent, initargs=end
    ) as pool:
        yield from pool.map(_evaluate, jobs, chunksize=_CHUNK)


def _evaluate(job: tuple[str, dict[str, float]]) -> Evaluation:
    return evaluate(*job)
