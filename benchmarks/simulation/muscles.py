"""Fit what is called fitted in the elbow's muscles, each on one data set, and show it on another.

`python -m benchmarks.simulation.muscles`: MuJoCo's curves to the published ones; the place of the
trochlea to the levers of Pigeon et al. 1996, shown on Sugisaki et al. 2010; the triceps' shortest
fibres and both scales of force to the torques of Buchanan et al. 1998, shown on Amis et al. 1980.
Then what each set of muscles gives.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from benchmarks.machine import describe_machine
from benchmarks.simulation.co_contraction import co_contraction_stiffness
from sim.assessment.assess import assess
from sim.body.muscles import holzbaur, physiological
from sim.body.muscles.authors import ELBOW_EXTENSORS, PAPER_MUSCLES
from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.body.muscles.lengths import SWEEP, elbow_lengths
from sim.body.muscles.muscle import ElbowMuscles, MuscleGroup, Wrap
from sim.body.muscles.physiological import PHYSIOLOGICAL_MUSCLES, TROCHLEA, round_the_elbow
from sim.body.muscles.places import near_elbow
from sim.parameters.conditions import MUSCLES
from sim.parameters.wearer import NOMINAL_WEARER
from sim.validation.isometric import (
    ANGLES_DEG,
    MEASURED,
    DataSet,
    IsometricTest,
    run_isometric_test,
)
from sim.validation.moment_arms import PIGEON, SUGISAKI

#: Lengths at which curves are compared, in optimal ones.
LENGTHS = np.linspace(0.5, 1.6, 111)
#: Wiegner and Watts 1986: stiffness of relaxed elbows, Nm/rad, from 20 to 107 degrees.
RELAXED = (0.4, 1.8)


def published_curves() -> tuple[np.ndarray, np.ndarray]:
    """Return active and passive force over peak force at LENGTHS (Thelen 2003, as in Arm26)."""
    active = np.exp(-((LENGTHS - 1.0) ** 2) / 0.5)
    passive = np.expm1(4.0 * np.maximum(LENGTHS - 1.0, 0.0) / 0.6) / np.expm1(4.0)
    return active, passive


def engine_curves(shortest: float, longest: float, peak: float) -> tuple[np.ndarray, np.ndarray]:
    """Return MuJoCo's curves at LENGTHS (its `mju_muscleGain` and `mju_muscleBias`)."""
    low, high = (1.0 + shortest) / 2.0, (1.0 + longest) / 2.0
    below = np.where(
        low >= LENGTHS,
        0.5 * ((LENGTHS - shortest) / (low - shortest)) ** 2,
        1.0 - 0.5 * ((1.0 - LENGTHS) / (1.0 - low)) ** 2,
    )
    above = np.where(
        high >= LENGTHS,
        1.0 - 0.5 * ((LENGTHS - 1.0) / (high - 1.0)) ** 2,
        0.5 * ((longest - LENGTHS) / (longest - high)) ** 2,
    )
    active = np.where(LENGTHS <= 1.0, below, above)
    active[(shortest > LENGTHS) | (longest < LENGTHS)] = 0.0
    stretch = np.maximum(LENGTHS - 1.0, 0.0) / (high - 1.0)
    passive = peak * np.where(stretch <= 1.0, 0.5 * stretch**2, stretch - 0.5)
    return active, passive


def print_curves() -> None:
    published = np.concatenate(published_curves())

    def gap(parameters: np.ndarray) -> np.ndarray:
        return np.asarray(np.concatenate(engine_curves(*parameters)) - published)

    found = least_squares(gap, [0.3, 1.7, 0.5])
    held = holzbaur.SHORTEST_ACTIVE, holzbaur.LONGEST_ACTIVE, holzbaur.PASSIVE_FORCE
    print("\nMuJoCo's curves nearest to the published ones, 0.5 to 1.6 optimal lengths")
    for name, values in (("fitted", found.x), ("in the code", np.array(held))):
        rms = np.sqrt(np.mean(gap(values) ** 2))
        print(
            f"  {name:12s} lmin {values[0]:5.2f}  lmax {values[1]:.2f}  fpmax {values[2]:.2f}  "
            f"{rms:.3f} rms"
        )


def with_trochlea(wrap: Wrap, shortest: float = physiological.SHORTEST) -> MuscleGroup:
    """Return the extensors of `physiological` with another trochlea or shortest fibre."""
    heads = tuple(round_the_elbow(muscle, wrap, shortest) for muscle in ELBOW_EXTENSORS)
    return replace(PHYSIOLOGICAL_MUSCLES.extensors, muscles=heads)


def lever(wrap: Wrap, degrees: np.ndarray) -> np.ndarray:
    """Return the lever of the lateral head, mm, positive extends."""
    elbow = replace(PHYSIOLOGICAL_MUSCLES, extensors=with_trochlea(wrap))
    lengths = elbow_lengths(NOMINAL_WEARER, elbow)["triceps_lateral"]
    arms: np.ndarray = 1e3 * np.interp(np.radians(degrees), SWEEP, np.gradient(lengths, SWEEP))
    return arms


def print_trochlea() -> None:
    degrees = np.arange(5.0, 116.0, 5.0)
    measured = -np.polyval(PIGEON["triceps"], degrees)

    def gap(place: np.ndarray) -> np.ndarray:
        wrap = replace(TROCHLEA, centre=near_elbow(place[0], 0.0054, place[1]))
        return lever(wrap, degrees) - measured

    found = least_squares(gap, [-0.003, -0.005], x_scale=1e-3, diff_step=1e-3).x
    print("\nTrochlea, mm distal and in front of the elbow (published: 1.5, -3.3)")
    fitted = replace(TROCHLEA, centre=near_elbow(found[0], 0.0054, found[1]))
    print(f"  fitted to Pigeon et al. 1996: {1e3 * found[0]:.1f}, {1e3 * found[1]:.1f}")
    for name, wrap in (("fitted", fitted), ("in the code", TROCHLEA)):
        rms = np.sqrt(np.mean((lever(wrap, degrees) - measured) ** 2))
        shown = ", ".join(
            f"{lever(wrap, np.array([angle]))[0]:.1f} at {angle} degrees ({-mean} sd {sd})"
            for angle, (mean, sd) in SUGISAKI.items()
        )
        print(f"  {name:12s} {rms:.1f} mm rms from Pigeon; Sugisaki et al. 2010: {shown}")


def gaps(test: IsometricTest, data: DataSet) -> np.ndarray:
    """Return how far both torques of a test are from an experiment, Nm, shape (2 n,)."""
    angles = np.array(data.angles_deg)
    held = angles <= ANGLES_DEG[-1]
    rows = []
    for curve, torque in (
        (test.flexion_nm, data.flexion_nm),
        (test.extension_nm, data.extension_nm),
    ):
        rows.append(np.interp(angles[held], ANGLES_DEG, curve) - np.array(torque)[held])
    return np.concatenate(rows)


def print_torques() -> None:
    amis, buchanan = MEASURED

    def elbow_of(values: np.ndarray) -> ElbowMuscles:
        shortest, flexors, extensors = values
        return ElbowMuscles(
            flexors=replace(PHYSIOLOGICAL_MUSCLES.flexors, force_scale=flexors),
            extensors=replace(with_trochlea(TROCHLEA, shortest), force_scale=extensors),
        )

    def gap(values: np.ndarray) -> np.ndarray:
        return gaps(run_isometric_test(elbow=elbow_of(values)), buchanan)

    held = np.array(
        [physiological.SHORTEST, physiological.FLEXORS_SCALE, physiological.EXTENSORS_SCALE]
    )
    found = least_squares(gap, held, diff_step=1e-2).x
    print("\nShortest fibres of the triceps, scales of flexors and extensors")
    for name, values in (("fitted", found), ("in the code", held)):
        test = run_isometric_test(elbow=elbow_of(values))
        rms = [np.sqrt(np.mean(gaps(test, data) ** 2)) for data in (buchanan, amis)]
        print(
            f"  {name:12s} {values[0]:.3f} {values[1]:.3f} {values[2]:.3f}: "
            f"{rms[0]:.1f} Nm rms from Buchanan et al. 1998 (fitted), "
            f"{rms[1]:.1f} from Amis et al. 1980 (shown)"
        )


def print_sets() -> None:
    print(
        "\nset             flexion peak      extension peak    relaxed  slope at 0.4  K_h true, r2"
    )
    wrapped = tuple(
        replace(round_the_elbow(m), operating_range=None) for m in PAPER_MUSCLES.extensors.muscles
    )
    alone = replace(PAPER_MUSCLES, extensors=replace(PAPER_MUSCLES.extensors, muscles=wrapped))
    for name, elbow in {**ELBOW_MUSCLES, "paper, wrapped": alone}.items():
        test = run_isometric_test(elbow=elbow)
        (flexion, at), (extension, where) = test.flexion_peak, test.extension_peak
        relaxed = -(test.passive_nm[107] - test.passive_nm[20]) / np.radians(87.0)
        slope = co_contraction_stiffness(ANGLES_DEG, test.flexion_nm, test.extension_nm, 0.4)
        line = (
            f"  {name:14s} {flexion:5.1f} Nm at {at:3.0f}  {extension:6.1f} Nm at {where:3.0f}  "
            f"{relaxed:7.1f}  {slope:11.1f}"
        )
        if name in MUSCLES:
            outputs = assess({"muscles": name}).outputs
            line += f"  {outputs['stiffness_true']:9.2f}, {outputs['stiffness_true_r2']:.2f}"
        print(line)
    print(f"  relaxed: 20 to 107 degrees, {RELAXED[0]} to {RELAXED[1]} in 19 subjects (Wiegner and")
    print("  Watts 1986); `paper, wrapped`: only the triceps' way is published, nothing else")


if __name__ == "__main__":
    print(describe_machine())
    print_curves()
    print_trochlea()
    print_torques()
    print_sets()
