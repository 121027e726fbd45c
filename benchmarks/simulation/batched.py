"""Whether several assessments in one process are faster than one at a time in several.

A worker runs one child process per core. Beside that stand two threads in one process, and the
engine's own batches: `mujoco.rollout` over many wearers on two threads.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from multiprocessing.pool import Pool, ThreadPool

import mujoco
import numpy as np
from mujoco import rollout

from sim.assessment.assess import assess
from sim.parameters.conditions import split
from sim.parameters.fidelity import CAMPAIGN, FIDELITIES
from sim.system.build import build_system
from sim.system.start import reset_to_start
from sim.system.system import System

#: Wearers of a batch and steps of each.
WEARERS, STEPS = 16, 200
#: Assessments that a rate is taken over, by fidelity.
COUNTS = {"campaign": 40, "bushing": 600}

Pools = Callable[..., Pool]


def run_nominal(fidelity: str, _: int) -> None:
    assess({}, fidelity=fidelity)


def rate(fidelity: str, pools: Pools, workers: int) -> float:
    """Return assessments per second with `workers` processes or threads."""
    one, count = partial(run_nominal, fidelity), COUNTS[fidelity]
    with pools(workers) as pool:
        pool.map(one, range(2 * workers), chunksize=1)
        started = time.perf_counter()
        pool.map(one, range(count), chunksize=max(1, count // 100))
        return count / (time.perf_counter() - started)


def systems_of(fidelity: str) -> list[System]:
    """Return the systems of wearers with light to heavy forearms."""
    found = []
    for mass in np.linspace(0.5, 1.5, WEARERS):
        wearer, conditions = split({"forearm_mass": float(mass)})
        found.append(build_system(wearer, conditions, FIDELITIES[fidelity]))
    return found


def batch_seconds(systems: Sequence[System], threads: int) -> float:
    """Return the seconds in which `mujoco.rollout` steps all systems on so many threads."""
    kind, first = mujoco.mjtState.mjSTATE_FULLPHYSICS, []
    for system in systems:
        data = reset_to_start(system)
        system.model.eq_active0[system.locks] = 1
        mujoco.mj_step(system.model, data, 20)
        state = np.empty(mujoco.mj_stateSize(system.model, kind))
        mujoco.mj_getState(system.model, data, state, kind)
        first.append(state)
    models = [system.model for system in systems]
    scratch = [mujoco.MjData(models[0]) for _ in range(threads)]
    started = time.perf_counter()
    rollout.rollout(models, scratch, np.array(first), nstep=STEPS)
    return time.perf_counter() - started


def print_rates() -> None:
    """Print what processes, threads and the engine's batches make of two cores."""
    print("\nAssessments per second (nominal wearer)")
    for fidelity in (CAMPAIGN.name, "bushing"):
        kinds_of: dict[Pools, tuple[str, str]] = {
            get_context("spawn").Pool: ("1 process", "2 processes"),
            ThreadPool: ("1 thread", "2 threads"),
        }
        for pools, kinds in kinds_of.items():
            for workers, kind in enumerate(kinds, start=1):
                found = rate(fidelity, pools, workers)
                print(f"  {fidelity:10s} {kind:12s} {found:7.2f}", flush=True)
    print(
        f"Batched: mujoco.rollout over {WEARERS} wearers, the engine's part of an assessment alone"
    )
    for fidelity in (CAMPAIGN.name, "bushing"):
        systems = systems_of(fidelity)
        one, two = (min(batch_seconds(systems, n) for _ in range(3)) for n in (1, 2))
        print(f"  {fidelity:10s} 2 threads {one / two:.2f} times as fast as 1", flush=True)
