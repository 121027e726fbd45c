"""The repaired robot as a model that a study can sample: its found numbers, uncertain as found.

The robot repeats a recorded trial: a servo of each joint follows the recorded positions, and the
outputs are the torques (forces) that the joints' motors have to give for it, and their travel. So a
study says which of the numbers that the trials left uncertain matters for what the robot must do.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.device import Device
from models.mjcf.compiling import compiled, written

#: Natural frequency of the servos, rad/s, critically damped by the joint's inertia at the start.
SERVO = 2 * np.pi * 30.0
#: Longest time step and longest piece of a trial, s; samples of the followed path, Hz.
STEP, LONGEST, RATE = 2e-3, 30.0, 200.0
#: Where an effect's parameter is in the repaired model, and with which sign.
PLACES: Mapping[tuple[str, str], tuple[str, float]] = {
    ("coulomb_friction", "torque"): ("joint.{joint}.frictionloss", 1.0),
    ("viscous_friction", "damping"): ("joint.{joint}.damping", 1.0),
    ("added_inertia", "inertia"): ("joint.{joint}.armature", 1.0),
    ("impedance", "stiffness"): ("joint.{joint}.stiffness", 1.0),
    ("impedance", "damping"): ("joint.{joint}.damping", 1.0),
    ("impedance", "neutral_angle"): ("joint.{joint}.springref", 1.0),
    # What the motor must add, where the actuator is what the joint feels.
    ("torque_offset", "torque"): ("actuator.effect_torque_offset_{joint}.biasprm", -1.0),
}
#: Of these attributes, those that MuJoCo takes from 0 on.
_NOT_NEGATIVE = ("frictionloss", "armature")


class NothingToSampleError(ValueError):
    """The report holds no number with an interval that MJCF has an attribute for."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A number of the report, and where it is in the repaired model."""

    name: str
    unit: str
    #: As `sets` of `model.toml` has it.
    path: str
    value: float
    low: float
    high: float
    what: str


def write_model(session: Path, report: Path, out: Path, name: str) -> list[str]:
    """Write the folder `out` with `model.toml`, the robot and its path; return what it lacks.

    Args:
        session: the measured session's folder.
        report: the folder of its report, from `rehyb close-loop`.
        out: made if missing.
        name: of the model.

    Raises:
        SessionError: the session cannot be read.
        NothingToSampleError: there is nothing to sample.
        OSError, ValueError: the report cannot be read.
    """
    content = json.loads((report / "report.json").read_text(encoding="utf-8"))
    recording = load_session(session)
    trial = _followed(recording.session.trials)
    spec = mujoco.MjSpec.from_string((report / "model_after.xml").read_text(encoding="utf-8"))
    joints = [joint.name for joint in spec.joints]
    time, path = _path(trial, joints)
    factors, lacks = _factors(content, spec)
    if not factors:
        raise NothingToSampleError(
            "the report has no number with an interval that MJCF has an attribute for: "
            + ("; ".join(lacks) or "nothing was found or fitted")
        )
    _with_servos(spec, joints, path)
    out.mkdir(parents=True, exist_ok=True)
    (out / "robot.xml").write_text(written(spec), encoding="utf-8")
    header = ",".join(["time", *joints])
    np.savetxt(
        out / "path.csv", np.column_stack([time, path]), "%.9g", ",", header=header, comments=""
    )
    toml = _toml(name, trial, float(time[-1]), factors, joints, recording.device)
    (out / "model.toml").write_text(toml, encoding="utf-8")
    return lacks


def _followed(trials: tuple[Trial, ...]) -> Trial:
    """Return the longest trial that no fit has seen; the longest of all if there is none."""
    return max(trials, key=lambda trial: (trial.role == "holdout", trial.time[-1] - trial.time[0]))


def _path(trial: Trial, joints: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return times from 0 (s) and the positions of the joints (rad or m) that are followed."""
    missing = [joint for joint in joints if f"{joint}.position" not in trial.columns]
    if missing:
        raise SessionError(
            f"the robot cannot follow it: there is no {missing[0]}.position", file=trial.file
        )
    own = trial.time - trial.time[0]
    end = min(float(own[-1]), LONGEST)
    time = np.linspace(0.0, end, max(2, round(end * RATE) + 1))
    columns = [np.interp(time, own, trial.columns[f"{joint}.position"]) for joint in joints]
    return time, np.column_stack(columns)


def _factors(report: Mapping[str, Any], spec: mujoco.MjSpec) -> tuple[list[Found], list[str]]:
    """Return the numbers to sample, and in sentences what cannot be."""
    found: dict[str, Found] = {}
    lacks = []
    for effect, joint, parameter, entry in _numbers(report):
        what = f"{effect} {parameter} at {joint}"
        if (effect, parameter) not in PLACES:
            lacks.append(f"{what}: is no single number in MJCF")
            continue
        place, sign = PLACES[effect, parameter]
        path = place.format(joint=joint)
        element, attribute = place.split(".")[0], place.rpartition(".")[2]
        value, interval = entry["value"], entry["ci90"]
        if value is None or not interval or not interval[0] < interval[1]:
            lacks.append(f"{what}: no interval")
            continue
        if path in found:
            lacks.append(f"{what}: {found[path].what} is the same number in MJCF")
            continue
        named = path.removeprefix(f"{element}.").removesuffix(f".{attribute}")
        target = spec.joint(named) if element == "joint" else spec.actuator(named)
        if target is None:
            lacks.append(f"{what}: is not in model_after.xml")
            continue
        present = float(np.ravel(getattr(target, attribute))[0])
        low, high = sorted(present + sign * (end - value) for end in interval)
        floor = 0.0 if attribute in _NOT_NEGATIVE else -np.inf
        low, high = max(low, floor), max(high, floor)
        if not low < high:
            lacks.append(f"{what}: its interval lies where MuJoCo takes no {attribute}")
            continue
        found[path] = Found(
            name=_name(f"{joint}.{effect}.{parameter}"),
            unit=entry["unit"],
            path=path,
            value=float(np.clip(present, low, high)),
            low=low,
            high=high,
            what=what,
        )
    return [*found.values()], lacks


def _numbers(report: Mapping[str, Any]) -> Iterator[tuple[str, str, str, Mapping[str, Any]]]:
    """Yield effect, joint, parameter and {"value", "ci90", "unit"} of what was fitted and found."""
    effects = report["effects"] if report["verdict"] == Verdict.EFFECT_FOUND else []
    for effect in effects:
        for parameter, entry in effect["parameters"].items():
            # Another than the joint only of what is no single number of the model.
            yield effect["name"], effect.get("where", effect["joint"]), parameter, entry
    for declared in report["declared"]:
        for parameter, entry in declared["parameters"].items() if "joint" in declared else ():
            yield declared["effect"], declared["joint"], parameter, entry
    for joint, impedance in report["impedance"].items():
        for parameter, entry in impedance.items():
            fitted = {"value": entry["after"], "ci90": entry["ci90_after"], "unit": entry["unit"]}
            yield "impedance", joint, parameter, fitted


def _with_servos(spec: mujoco.MjSpec, joints: list[str], path: np.ndarray) -> None:
    """Let each joint follow a position, from the path's start on, and measure its motor."""
    model = compiled(spec)
    data = mujoco.MjData(model)
    addresses = [int(model.joint(joint).qposadr[0]) for joint in joints]
    data.qpos[addresses] = path[0]
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    spec.option.timestep = min(spec.option.timestep, STEP)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in joints:
        dof = int(model.joint(joint).dofadr[0])
        stiffness = float(inertia[dof, dof]) * SERVO**2
        actuator = spec.add_actuator(
            name=f"{joint}.servo", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint
        )
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = stiffness
        actuator.biasprm[:3] = 0.0, -stiffness, -2.0 * stiffness / SERVO
        for word, kind, of, what in (
            ("torque", mujoco.mjtSensor.mjSENS_ACTUATORFRC, mujoco.mjtObj.mjOBJ_ACTUATOR, ".servo"),
            ("position", mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtObj.mjOBJ_JOINT, ""),
        ):
            spec.add_sensor(name=f"{joint}.{word}", type=kind, objtype=of, objname=f"{joint}{what}")
    spec.add_key(name="start", qpos=data.qpos)
    # Of effects that nobody applies here; MuJoCo writes some that it does not read again.
    for text in [*spec.texts]:
        spec.delete(text)


def _toml(
    name: str, trial: Trial, seconds: float, factors: list[Found], joints: list[str], device: Device
) -> str:
    lines = [
        "# The robot as `rehyb close-loop` repaired it, along a recorded trial.",
        "[model]",
        f"name = {json.dumps(name)}",
        f"description = {json.dumps(f'repaired, along {trial.file}'[:400])}",
        'kind = "mjcf"',
        "",
    ]
    for factor in factors:
        lines += [
            "[[factors]]",
            f"name = {json.dumps(factor.name)}",
            f"unit = {json.dumps(factor.unit)}",
            f"low = {factor.low!r}",
            f"high = {factor.high!r}",
            f"nominal = {factor.value!r}",
            f"description = {json.dumps(factor.what)}",
            f"sets = [{json.dumps(factor.path)}]",
            "",
        ]
    for joint in joints:
        for quantity, sensor, reduce, unit in (
            ("torque_rms", "torque", "rms", device.unit(joint)),
            ("torque_peak", "torque", "peak", device.unit(joint)),
            ("travel", "position", "range", device.angle_unit(joint)),
        ):
            lines += [
                "[[outputs]]",
                f"name = {json.dumps(_name(f'{joint}.{quantity}'))}",
                f"unit = {json.dumps(unit)}",
                f"sensor = {json.dumps(f'{joint}.{sensor}')}",
                f"reduce = {json.dumps(reduce)}",
                "",
            ]
    lines += ["[mjcf]", 'file = "robot.xml"', f"duration = {seconds!r}", 'keyframe = "start"', ""]
    lines += ["[mjcf.controls]"]
    lines += [
        f'{json.dumps(f"{joint}.servo")} = {{file = "path.csv", column = {json.dumps(joint)}}}'
        for joint in joints
    ]
    return "\n".join(lines) + "\n"


def _name(text: str) -> str:
    """Return a text as a name of a factor or an output."""
    word = re.sub(r"[^A-Za-z0-9_.-]", "_", text)[:64]
    return word if re.match(r"[A-Za-z_]", word) else f"_{word}"[:64]
