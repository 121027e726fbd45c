"""The full simulation as a patient: trials of the arm in the exoskeleton as a measured session.

The robot moves the arm to and fro, at several speeds over two ranges, and keeps
what a laboratory would: time, joint angles and the elbow motor's torque. Whatever the arm, the
tissue, the fit of the device or an undeclared effect do to these signals is in them; a nominal
model is all that the analysis gets (`docs/use/close_loop.md`).
"""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim.assessment.estimation import fit
from sim.assessment.protocol import run_protocol
from sim.assessment.record import Record
from sim.assessment.steps import Motion
from sim.parameters.conditions import split
from sim.parameters.fidelity import CAMPAIGN, Fidelity, fidelity_of
from sim.parameters.target import ELBOW_TARGET
from sim.robot.device import JOINTS, NESM
from sim.system.build import build_system
from sim.system.start import reset_to_start

#: The sigmoid's half width in its rates: at that distance from its centre it has hardly begun.
SETTLED = 5.0
#: Rest at both ends of the range, s.
PAUSE = 0.5
#: Noise of the torque sensor, Nm, and resolution of the encoders, rad (20 bits a turn).
TORQUE_NOISE, ENCODER = 0.05, 2 * np.pi / 2**20


@dataclass(frozen=True, kw_only=True)
class Exercise:
    """One trial: the elbow extends and flexes again, so and so often."""

    name: str
    #: Rate of both sigmoids, 1/s, and how far the elbow extends, rad.
    rate: float
    amplitude: float
    #: How often, there and back.
    cycles: int
    role: str = "fit"


#: Three speeds over the whole range and over its flexed half, and a pair that no fit sees.
EXERCISES = (
    Exercise(name="slow", cycles=2, rate=2.0, amplitude=1.4),
    Exercise(name="medium", cycles=3, rate=3.0, amplitude=1.4),
    Exercise(name="fast", cycles=4, rate=4.5, amplitude=1.4),
    Exercise(name="slow_half", cycles=2, rate=2.0, amplitude=0.8),
    Exercise(name="medium_half", cycles=3, rate=3.0, amplitude=0.8),
    Exercise(name="fast_half", cycles=4, rate=4.5, amplitude=0.8),
    Exercise(name="holdout", cycles=3, rate=3.5, amplitude=1.1, role="holdout"),
)
#: Where the robot begins: the upper arm as in an assessment, the elbow with room for an overshoot.
START = tuple(np.radians([0.0, -90.0, 0.0, 95.0]).tolist())


def to_and_fro(exercise: Exercise, start: float, step: float) -> Motion:
    """Return an exercise's reference from elbow angle `start` (rad), sampled every `step` s."""
    half = SETTLED / exercise.rate
    stroke = 2 * half + PAUSE
    time = np.arange(round((2 * exercise.cycles * stroke + PAUSE) / step)) * step
    angle, velocity = np.full_like(time, start), np.zeros_like(time)
    for number in range(2 * exercise.cycles):
        sign = 1.0 if number % 2 else -1.0
        centre = half + number * stroke
        sigmoid = 1.0 / (1.0 + np.exp(-exercise.rate * (time - centre)))
        first = 1.0 / (1.0 + np.exp(exercise.rate * centre))
        angle += sign * exercise.amplitude * (sigmoid - first)
        velocity += sign * exercise.amplitude * exercise.rate * sigmoid * (1.0 - sigmoid)
    return time, angle, velocity


def record_exercise(
    values: Mapping[str, float], exercise: Exercise, fidelity: str | Fidelity = CAMPAIGN.name
) -> Record:
    """Simulate one exercise of one wearer under the conditions and effects of `values`.

    Raises:
        FailedError: the simulated arm slipped, jammed or the like.
        ValueError: a factor or the fidelity is unknown.
    """
    start = replace(NESM.start(ELBOW_TARGET.name), angles=START)
    robot = replace(NESM, starts={ELBOW_TARGET.name: start})
    wearer, conditions = split(values)
    system = build_system(wearer, conditions, fidelity_of(fidelity), ELBOW_TARGET, robot)
    motion = to_and_fro(exercise, START[system.moved], system.fidelity.step)
    return run_protocol(system, reset_to_start(system), motion)


def true_impedance(records: list[Record]) -> tuple[float, float]:
    """Return the human joint's stiffness and damping over all records, in the restoring sense.

    Equation 9 with a neutral angle on the human joint's own angle: what no clinic can measure.
    """
    joint = records[0].joint
    torque = np.concatenate([record.human_torque for record in records])
    q, velocity = (
        np.concatenate([getattr(record, name)[:, joint] for record in records])
        for name in ("q", "q_velocity")
    )
    found = fit(torque, q, velocity, damping=True, constant=True)
    assert found.damping is not None
    return -found.stiffness, -found.damping


def write_session(
    folder: Path, exercises: tuple[Exercise, ...], records: list[Record], rng: np.random.Generator
) -> None:
    """Write records as a measured session whose model is the nominal arm.

    Args:
        folder: made if need be.
        exercises: what was recorded.
        records: one for each.
        rng: of the sensors' noise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    trials, begin = [], 0.0
    names = ["time", *(f"{joint}.position" for joint in JOINTS)]
    for exercise, record in zip(exercises, records, strict=True):
        moved = JOINTS[record.joint]
        position = np.round(record.theta / ENCODER) * ENCODER
        noise = TORQUE_NOISE * rng.standard_normal(len(record.time))
        effort = record.motor_torque[:, record.exo_joint] + noise
        table = np.column_stack([begin + record.time, position, effort])
        begin = float(table[-1, 0]) + 10.0
        with (folder / f"{exercise.name}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*names, f"{moved}.effort"])
            writer.writerows([f"{x:.9g}" for x in row] for row in table)
        trials.append(
            {
                "file": f"{exercise.name}.csv",
                "label": f"rate {exercise.rate:g}/s over {exercise.amplitude:g} rad",
                "group": exercise.name,
                "role": exercise.role,
            }
        )
    session = {
        "schema": 1,
        "model": "nominal",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": JOINTS[records[0].joint]}],
        "trials": trials,
    }
    (folder / "session.json").write_text(json.dumps(session, indent=2) + "\n")
