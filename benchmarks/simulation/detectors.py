"""How often the detectors fire in Table 1, how near they come to it, and what they do at faults.

`python -m benchmarks.simulation.detectors [POINTS IN CONTACT]`
"""

import sys
from collections import Counter
from collections.abc import Mapping
from itertools import product

import numpy as np
from scipy.stats import qmc

from benchmarks.machine import describe_machine
from sim.assessment.assess import Assessment, assess
from sim.assessment.validity import HOLD_BOUNDS
from sim.parameters.wearer import TABLE_1

SEED = 1
POINTS = {"bushing": 512, "campaign": 128}
#: Wearers and conditions that no number may come from.
FAULTS: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("campaign", {"cuff_friction": 0.0}),
    ("campaign", {"cuff_friction": 0.05, "strap_tension": 1.0}),
    ("campaign", {"upper_arm_elasticity": 1.0}),
    ("campaign", {"forearm_elasticity": 1.0}),
    ("campaign", {"forearm_mass": 10.0}),
    ("campaign", {"forearm_mass": 15.0}),
    ("campaign", {"upper_arm_length": 0.43}),
    ("bushing", {"upper_arm_length": 0.43}),
    ("bushing", {"forearm_elasticity": 1.0}),
    ("bushing", {"forearm_mass": 10.0}),
)


def wearer(unit: np.ndarray) -> dict[str, float]:
    """Return the wearer at a point of the unit cube, shape (6,)."""
    return {f.name: f.low + float(x) * (f.high - f.low) for f, x in zip(TABLE_1, unit, strict=True)}


def print_wearers(title: str, units: np.ndarray, fidelity: str) -> None:
    """Print the outcomes at points of the unit cube, and how near each bound came."""
    found = [assess(wearer(unit), fidelity=fidelity) for unit in units]
    outcomes = Counter(assessment.outcome for assessment in found).most_common()
    print(f"\n{title}: {', '.join(f'{count} {name}' for name, count in outcomes)}")
    for unit, assessment in zip(units, found, strict=True):
        if assessment.outcome != "ok":
            values = ", ".join(f"{n} {v:.4g}" for n, v in wearer(unit).items())
            print(f"  {assessment.outcome}: {assessment.reason}; {values}")
    for bound in HOLD_BOUNDS:
        print(f"  {bound.quantity:14s} {bound.which} {bound.scale * bound.limit:5.3g}", end="")
        print(f"   farthest: {bound.scale * farthest(found, bound.quantity, bound.which):.3g}")


def farthest(found: list[Assessment], quantity: str, which: str) -> float:
    """Return what came nearest to its bound in assessments that came to their end."""
    ends = [getattr(a.record.loads, quantity) for a in found if a.record is not None]
    return float(np.max(ends) if which == "at most" else np.min(ends))


def main(in_contact: int) -> None:
    print(describe_machine())
    for fidelity, points in (POINTS | {"campaign": in_contact}).items():
        units = qmc.Sobol(len(TABLE_1), rng=SEED).random(points)
        print_wearers(f"{fidelity}, {points} Sobol points of Table 1", units, fidelity)
        corners = np.array(list(product((0.0, 1.0), repeat=len(TABLE_1))))
        print_wearers(f"{fidelity}, {len(corners)} corners", corners, fidelity)
    print("\nFaults")
    for fidelity, values in FAULTS:
        assessment = assess(values, fidelity=fidelity)
        told = ", ".join(f"{name} {value:g}" for name, value in values.items())
        print(f"  {fidelity}, {told}: {assessment.outcome}, {assessment.reason}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else POINTS["campaign"])
