"""The full simulation as a patient, analysed blind with the nominal model: K_h before and after.

`python -m benchmarks.closeloop.patient [--fidelity campaign] [--plain] [CASE ...]`

The truth is the slope of the elbow's own torque over its own angle, in the restoring sense, which
only a simulation knows. `--plain` takes arms without any undeclared effect instead, of
several sizes and tissues, and prints how large the torque is that effects would be credited with,
from which the limit in `analysis.closeloop.identification.interface` comes.
"""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate, impedances
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.interface import unique_torque
from analysis.closeloop.identification.tracing import trace
from analysis.closeloop.load import load_session
from analysis.closeloop.loop import analyse
from benchmarks.machine import describe_machine
from sim.assessment.validity import FailedError
from sim.parameters.fidelity import FIDELITIES
from sim.parameters.wearer import NOMINAL
from tests.testbed.sessions.patient import (
    EXERCISES,
    Exercise,
    record_exercise,
    true_impedance,
    write_session,
)

#: An arm at rest as in an assessment of spasticity: the passive force of the paper's muscles makes
#: it 6 Nm/rad stiff.
RELAXED = {"activation": 0.05}
CASES: Mapping[str, Mapping[str, float]] = {
    "plain arm": {},
    "upper arm 20 mm longer": {"upper_arm_length": NOMINAL["upper_arm_length"] + 0.02},
    "soft tissue, a third": {"tissue_scale": 0.33},
    "robot friction 2.8 Nm": {"effect.coulomb_friction.torque": 2.8},
    "friction, arm 20 mm longer": {
        "effect.coulomb_friction.torque": 2.8,
        "upper_arm_length": NOMINAL["upper_arm_length"] + 0.02,
    },
    "catch in extension": {
        "effect.stretch_reflex.gain": 12.0,
        "effect.stretch_reflex.threshold_velocity": 0.3,
        "effect.stretch_reflex.delay": 0.04,
        "effect.stretch_reflex.side": -1.0,
    },
    "forearm 0.5 kg heavier": {"forearm_mass": NOMINAL["forearm_mass"] + 0.5},
    "straps slack (5 N)": {"strap_tension": 5.0},
}
#: Arms without an effect, from Table 1's corners and the conditions.
PLAIN: Mapping[str, Mapping[str, float]] = {
    "nominal": {},
    "20 mm longer": {"upper_arm_length": NOMINAL["upper_arm_length"] + 0.02},
    "44 mm longer": {"upper_arm_length": NOMINAL["upper_arm_length"] + 0.044},
    "44 mm shorter": {"upper_arm_length": NOMINAL["upper_arm_length"] - 0.044},
    "heavy": {"forearm_mass": 1.6},
    "light": {"forearm_mass": 0.4},
    "soft": {"tissue_scale": 0.33},
    "hard": {"upper_arm_elasticity": 970.0, "forearm_elasticity": 970.0},
    "rough cuffs": {"cuff_friction": 0.8},
    "half tense": {"activation": 0.2},
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What closing the loop made of one arm; stiffness in Nm/rad, restoring."""

    truth: float
    #: The same arm without what was not declared, measured with the nominal model.
    plain: float
    before: float
    after: float
    verdict: str
    effects: tuple[str, ...]
    holdout_before: float
    holdout_after: float


def session_of(
    folder: Path,
    values: Mapping[str, float],
    fidelity: str,
    exercises: tuple[Exercise, ...] = EXERCISES,
) -> float:
    """Record a session in `folder` and return the true stiffness over its fit trials."""
    records = [record_exercise(RELAXED | dict(values), e, fidelity) for e in exercises]
    write_session(folder, exercises, records, np.random.default_rng(1))
    fitted = [r for r, e in zip(records, exercises, strict=True) if e.role == "fit"]
    return true_impedance(fitted)[0]


def run(values: Mapping[str, float], fidelity: str) -> Outcome:
    """Record one arm and analyse it blind."""
    with tempfile.TemporaryDirectory() as directory:
        truth = session_of(Path(directory), values, fidelity)
        report = analyse(Path(directory)).report
        without = {name: v for name, v in values.items() if name == "upper_arm_length"}
        session_of(Path(directory), without, fidelity)
        plain = declared_stiffness(Path(directory))
    stiffness, error = report["impedance"]["J4"]["stiffness"], report["error"]["holdout"]["J4"]
    return Outcome(
        truth=truth,
        plain=plain,
        before=stiffness["before"],
        after=stiffness["after"],
        verdict=report["verdict"],
        effects=tuple(effect["name"] for effect in report["effects"]),
        holdout_before=error["before"],
        holdout_after=error["after"],
    )


def declared_stiffness(folder: Path) -> float:
    """Return what the declared model alone makes of a session's stiffness, Nm/rad."""
    recording = load_session(folder)
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    return impedances(model, evaluate(model, rows).coefficients)[recording.joints[0]]["stiffness"]


def print_cases(names: list[str], fidelity: str) -> None:
    """Print the table of docs/measurements/patient.md."""
    print(
        f"{'undeclared':28s} {'K true':>7s} {'plain':>6s} {'before':>7s} {'after':>7s} "
        f"{'error: plain':>13s} {'before':>7s} {'after':>7s}  {'held-out, Nm':>12s}  answer"
    )
    for name in names or CASES:
        try:
            o = run(CASES[name], fidelity)
        except FailedError as failed:
            print(f"{name:28s} the trial failed: {failed.failure.reason}")
            continue
        errors = [100 * (k / o.truth - 1) for k in (o.plain, o.before, o.after)]
        print(
            f"{name:28s} {o.truth:7.2f} {o.plain:6.2f} {o.before:7.2f} {o.after:7.2f} "
            f"{errors[0]:+12.1f}% {errors[1]:+6.1f}% {errors[2]:+6.1f}%  "
            f"{o.holdout_before:4.2f} -> {o.holdout_after:4.2f}  "
            f"{o.verdict} {', '.join(o.effects)}",
            flush=True,
        )


def sizes(found: Trace) -> dict[str, float]:
    """Return the size of every effect that tracing would name, Nm."""
    named = found.verdict == "effect_found"
    if not found.steps:
        return {}
    first = found.steps[0].taken
    model, score = (found.model, found.score) if named else (first.model, first.score)
    steps = found.steps if named else found.steps[:1]
    return {
        step.taken.candidate.effect.name: size
        for step in steps
        if (size := unique_torque(step, found.declared, model, score.coefficients, found.rows))
        is not None
    }


def print_plain(names: list[str], fidelity: str) -> None:
    """Print what would be blamed on arms without any undeclared effect."""
    largest = 0.0
    for name in names or PLAIN:
        with tempfile.TemporaryDirectory() as directory:
            try:
                session_of(Path(directory), PLAIN[name], fidelity)
            except FailedError as failed:
                print(f"{name:16s} the trial failed: {failed.failure.reason}")
                continue
            recording = load_session(Path(directory))
            found = sizes(trace(recording))
        largest = max([largest, *found.values()])
        text = ", ".join(f"{effect} {size:.2f} Nm" for effect, size in found.items())
        print(f"{name:16s} {text or 'nothing'}", flush=True)
    print(f"largest: {largest:.2f} Nm")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="default: all")
    parser.add_argument("--fidelity", default="campaign", choices=tuple(FIDELITIES))
    parser.add_argument("--plain", action="store_true", help="arms without an effect")
    options = parser.parse_args()
    known = PLAIN if options.plain else CASES
    for name in options.cases:
        if name not in known:
            parser.error(f"there is no case {name!r}: take one of {', '.join(known)}")
    print(describe_machine())
    (print_plain if options.plain else print_cases)(options.cases, options.fidelity)


if __name__ == "__main__":
    main()
