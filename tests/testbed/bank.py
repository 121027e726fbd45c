"""A bank without a simulation: wearers of whom K, and two factors, show in the curves."""

from dataclasses import replace
from functools import cache

import numpy as np

from analysis.interpretation.bank.bank import KEPT, Bank, Samples, empty_samples
from analysis.interpretation.bank.population import Population, population_of
from analysis.interpretation.inference import gaussian_process
from analysis.interpretation.inference.interpreter import Interpreter
from sim.models import CURVES, WINDOWS

NORMAL = {"kind": "truncated_normal", "mean": 0.3, "sd": 0.02, "low": 0.25, "high": 0.35}
CONTENT = {
    "schema": 1,
    "name": "made up",
    "factors": {
        "forearm_length": {
            "distribution": NORMAL,
            "source": "made up",
            "measure": {"to": 0.002, "minutes": 2, "how": "tape"},
        },
        "forearm_mass": {
            "distribution": {"kind": "uniform", "low": 0.5, "high": 1.5},
            "source": "made up",
            "measure": {"to": 0.02, "minutes": 5, "how": "scales"},
        },
        "muscles": {
            "distribution": {"kind": "discrete", "values": [0, 2], "probabilities": [0.5, 0.5]},
            "source": "made up",
        },
    },
    "sensors": {"torque_zero": {"sd": 0.01}},
}


def population() -> Population:
    """Return who may come."""
    return population_of(CONTENT, "made up")


def samples(seed: int, count: int, strange: float = 0.0) -> Samples:
    """Return made up recordings: the elbow's torque is K theta, and heavier arms sag.

    Half of what a centimetre of forearm adds to K shows nowhere: only a tape measure tells.
    """
    people, rows = population(), np.arange(count)
    factors = people.draw(seed, rows)
    rng = np.random.default_rng([seed, 7])
    length = (factors[:, 0] - 0.3) / 0.02
    k = rng.uniform(1.0, 6.0, count)
    phase = np.linspace(0.0, 1.0, WINDOWS)
    curves = np.zeros((count, len(CURVES)))
    angle = 1.9 - 1.75 * phase + strange * np.sin(9.0 * phase)
    curves[:, :WINDOWS] = angle + 0.002 * rng.standard_normal((count, WINDOWS))
    shown = k + 0.5 * length
    curves[:, -WINDOWS:] = -shown[:, None] * angle
    curves[:, WINDOWS : 2 * WINDOWS] = factors[:, [1]]
    curves[:, WINDOWS:] += 0.01 * rng.standard_normal((count, len(CURVES) - WINDOWS))
    found = {name: curves[:, i] for i, name in enumerate(CURVES)}
    found |= {"affine_stiffness": -shown, "paper_stiffness": -shown, "true_stiffness": k}
    found |= {f"local_stiffness_{place}": -k for place in ("start", "middle", "end")}
    found |= {"true_damping": 0.1 * k + 0.05 * rng.standard_normal(count)}
    noise = 0.01 * rng.standard_normal((count, len(KEPT)))
    values = np.column_stack([found.get(name, noise[:, i]) for i, name in enumerate(KEPT)])
    return Samples(rows=rows, factors=factors, values=values, failed={})


@cache
def bank() -> Bank:
    """Return a bank that was learnt from."""
    people = population()
    made = Bank(
        population=people,
        seed=1,
        bushing=samples(1, 240),
        contact=empty_samples(len(people.names)),
        versions={},
        fitted={},
    )
    rows, gaussian_process.TUNING_ROWS = gaussian_process.TUNING_ROWS, 60
    try:
        return replace(made, fitted=Interpreter.fit(made).arrays)
    finally:
        gaussian_process.TUNING_ROWS = rows
