"""A bank's recordings as a study of method sample, which a fleet computes."""

import hashlib
import json
from collections import Counter
from math import asin, pi
from typing import Any

import numpy as np

from analysis.interpretation.bank.bank import CONTACT_ROWS, KEPT, LEVELS, Samples
from analysis.interpretation.bank.population import Population
from analysis.interpretation.errors import InterpretationError
from analysis.sensitivity.table import Table
from sim.parameters.conditions import CONTACT_ONLY


def study_of(population: Population, seed: int, level: str, rows: int) -> dict[str, Any]:
    """Return the study that samples `rows` wearers of a population at a level, as JSON.

    The copula's correlations are given as those of ranks (Pearson 1907), which `sample` turns back.

    Args:
        population: who may come.
        seed: of the bank's draw. Levels have seeds of their own: no wearer is in both.
        level: "bushing" or "contact".
        rows: how many wearers.

    Raises:
        InterpretationError: without contact, a factor that is left out depends on one that is not.
    """
    left = set() if level == "contact" else set(CONTACT_ONLY)
    pairs = []
    for i, one in enumerate(population.names):
        for j, other in enumerate(population.names[:i]):
            value = float(population.correlation[i, j])
            if value == 0.0 or {one, other} <= left:
                continue
            if {one, other} & left:
                raise InterpretationError(
                    f"{one} and {other} of {population.name} depend on each other, and one of them "
                    "means nothing without contact: build this bank without --submit"
                )
            pairs.append([other, one, 6.0 / pi * asin(value / 2.0)])
    digest = hashlib.sha256(json.dumps(population.content, sort_keys=True).encode()).hexdigest()
    own = hashlib.sha256(f"{seed} {level}".encode()).digest()
    return {
        "name": f"bank of {population.name[:60]} {digest[:8]}, {level}, seed {seed}",
        "model": LEVELS[level],
        "method": "sample",
        "sampling": "sobol",
        "rows": rows,
        "seed": int.from_bytes(own[:7], "big"),
        "factors": [
            {"name": name, "distribution": population.distributions[name].to_json()}
            for name in population.names
            if name not in left
        ],
        "fixed": {name: value for name, value in population.fixed.items() if name not in left},
        "correlations": pairs,
        "outputs": list(KEPT),
    }


def samples_of(population: Population, seed: int, level: str, table: Table, rows: int) -> Samples:
    """Return what a bank keeps of the first `rows` results of a study of `study_of`.

    One level of two (Kennedy and O'Hagan 2000). Factors that mean nothing without contact are drawn
    here, as where a bank is built alone.
    """
    order = np.argsort(table.rows)[:rows]
    drawn = population.draw(seed, table.rows[order])
    for column, name in enumerate(population.names):
        if name in table.plan.factors:
            drawn[:, column] = table.points[order, table.plan.factors.index(name)]
    values = table.values[order][:, [table.plan.outputs.index(name) for name in KEPT]]
    outcomes = [table.outcomes[i] for i in order]
    believed = np.isfinite(values).all(axis=1) & np.array([one == "ok" for one in outcomes], bool)
    failed = Counter(one for one, kept in zip(outcomes, believed, strict=True) if not kept)
    first = CONTACT_ROWS if level == "contact" else 0
    return Samples(
        rows=first + table.rows[order][believed],
        factors=drawn[believed],
        values=values[believed],
        failed=dict(sorted(failed.items())),
    )
