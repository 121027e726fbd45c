"""The nominal assessment beside the authors' model, and 100 wearers from all over Table 1.

`python -m benchmarks.simulation.table_1 [POINTS]`
"""

import sys
import time
from collections import Counter
from itertools import product

import numpy as np
from scipy.stats import qmc

from benchmarks.machine import describe_machine
from benchmarks.simulation.co_contraction import COMMON_DEG, co_contraction_stiffness
from sim.assessment.assess import assess
from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.body.skeleton import AUTHORS_ELBOW_OFFSET
from sim.parameters.wearer import NOMINAL, TABLE_1
from sim.validation import AUTHORS
from sim.validation.isometric import ANGLES_DEG, MEASURED, IsometricTest, run_isometric_test

SEED = 7


def print_nominal() -> None:
    outputs, papers = assess({}).outputs, assess({"elbow_offset": AUTHORS_ELBOW_OFFSET}).outputs
    print(
        "Nominal wearer, Nm/rad           ours                authors' model      as far off axis"
    )
    print(
        "form       estimate    true   error   estimate    true   error   estimate    true   error"
    )
    for form, (estimate, true) in AUTHORS.items():
        suffix = "" if form == "affine" else f"_{form}"
        ours, old = (
            [values[f"stiffness_{name}{suffix}"] for name in ("estimate", "true", "error")]
            for values in (outputs, papers)
        )
        print(
            f"{form:10s} {ours[0]:8.2f} {ours[1]:7.2f} {ours[2]:7.2f} "
            f"{estimate:10.2f} {true:7.2f} {estimate - true:7.2f} "
            f"{old[0]:10.2f} {old[1]:7.2f} {old[2]:7.2f}"
        )
    for name, unit in (
        ("damping_estimate", "Nm s/rad"),
        ("peak_contact_force", "N"),
        ("tracking_rmse", "rad"),
    ):
        print(f"{name}: {outputs[name]:.3f} {unit}")


def print_differences() -> None:
    """Show what the authors' undeclared friction and mass do to the error in their own form."""
    print("\nError in the authors' form, with what their model has and their nominal model lacks")
    for label, values in (
        ("ours", {}),
        ("+ 2.79 Nm Coulomb friction in the robot's elbow", {"robot_friction": 2.79}),
        ("+ 1 kg more on the forearm (their strap: 1.2 kg)", {"forearm_mass": 1.962}),
    ):
        outputs = assess(values).outputs
        print(f"  {label:50s} {outputs['stiffness_error_authors']:6.2f} Nm/rad")


def distance_of_extension(test: IsometricTest) -> float:
    """Return how far the extension torque is from both experiments, Nm, root mean square."""
    gaps = [
        np.interp(angle, ANGLES_DEG, test.extension_nm) - torque
        for data in MEASURED
        for angle, torque in zip(data.angles_deg, data.extension_nm, strict=True)
        if angle <= ANGLES_DEG[-1]
    ]
    return float(np.sqrt(np.mean(np.square(gaps))))


def print_co_contraction() -> None:
    """Show what the isometric torques say of the sign and size of K_h, and relaxed muscles do."""
    print("\nSlope of the isometric torque at an activation of 0.4, elbow at 20 to 110 degrees")
    rows, relaxed = [], []
    for flexors in MEASURED:
        for extensors in MEASURED:
            both = flexors.source, extensors.source
            flexion = np.interp(COMMON_DEG, flexors.angles_deg, flexors.flexion_nm)
            extension = np.interp(COMMON_DEG, extensors.angles_deg, extensors.extension_nm)
            rows.append((", ".join(dict.fromkeys(both)), COMMON_DEG, flexion, extension))
    for name, elbow in ELBOW_MUSCLES.items():
        test = run_isometric_test(elbow=elbow)
        rows.append((name, ANGLES_DEG, test.flexion_nm, test.extension_nm))
        relaxed.append((name, test.passive_nm, distance_of_extension(test)))
    print(f"  {'flexors, extensors':38s} flexors  extensors    both")
    for name, angles, flexion, extension in rows:
        none = np.zeros(len(angles))
        slopes = [
            co_contraction_stiffness(angles, f, e, 0.4)
            for f, e in ((flexion, none), (none, extension), (flexion, extension))
        ]
        print(f"  {name:38s} {slopes[0]:7.2f}  {slopes[1]:9.2f}  {slopes[2]:6.2f} Nm/rad")
    for name, passive, distance in relaxed:
        stiffness = (passive[20] - passive[107]) / np.radians(87.0)
        print(f"  {name}: extension {distance:.1f} Nm rms from both experiments; relaxed, flexes")
        print(f"    with at most {passive.max():.1f} Nm, {stiffness:.1f} Nm/rad at 20 to 107 deg")


def print_corners() -> None:
    """Show which corners of Table 1 need an extension stop."""
    for stop in (0.0, 30.0):
        outcomes = Counter(
            assess({**dict(zip(NOMINAL, corner, strict=True)), "extension_stop": stop}).outcome
            for corner in product(*((factor.low, factor.high) for factor in TABLE_1))
        )
        found = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
        print(f"\n64 corners, extension_stop {stop:g} Nm/rad: {found}")


def print_table_1(points: int) -> None:
    unit = qmc.LatinHypercube(len(TABLE_1), rng=np.random.default_rng(SEED)).random(points)
    low, high = (np.array([getattr(f, end) for f in TABLE_1]) for end in ("low", "high"))
    outcomes: Counter[str] = Counter()
    stiffness, seconds = [], []
    for row in low + unit * (high - low):
        started = time.perf_counter()
        assessment = assess({f.name: float(v) for f, v in zip(TABLE_1, row, strict=True)})
        seconds.append(time.perf_counter() - started)
        outcomes[assessment.outcome] += 1
        if assessment.outcome == "ok":
            stiffness.append(
                [assessment.outputs[f"stiffness_{name}"] for name in ("estimate", "true", "error")]
            )
    print(f"\n{points} Latin-hypercube points of Table 1, seed {SEED}")
    for outcome, count in outcomes.most_common():
        print(f"  {outcome:20s} {count:5d}  {count / points:.1%}")
    mean, sd = np.mean(stiffness, axis=0), np.std(stiffness, axis=0, ddof=1)
    for i, name in enumerate(("estimate", "true", "error")):
        print(f"  stiffness_{name:9s} mean {mean[i]:6.2f}  sd {sd[i]:5.2f} Nm/rad")
    print(f"  seconds per assessment, one process: median {np.median(seconds):.2f}")


if __name__ == "__main__":
    print(describe_machine())
    print_nominal()
    print_differences()
    print_co_contraction()
    print_corners()
    print_table_1(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
