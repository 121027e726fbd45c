"""An arm of three joints, one of them upright, that moves one joint a trial or all at once."""

import json
from pathlib import Path

import mujoco
import numpy as np

from analysis.closeloop.load import load_session
from analysis.closeloop.session.recording import Recording

#: Where the fore's own mass is, m: only the pan axis feels how far aside of it a load hangs.
ASIDE = -0.02
ROBOT = f"""<mujoco><compiler angle="radian"/><worldbody>
<body name="turret" pos="0 0 0.2"><joint name="pan" axis="0 0 1" armature="0.1"/>
<inertial mass="4" pos="0 0 0.1" diaginertia="0.03 0.03 0.01"/>
<body name="arm" pos="0 0 0.3"><joint name="lift" axis="0 1 0" armature="0.07"/>
<inertial mass="4.5" pos="0.12 0 0" diaginertia="0.006 0.037 0.037"/>
<body name="fore" pos="0.26 0 0"><joint name="bend" axis="0 1 0" armature="0.02"/>
<inertial mass="1.5" pos="0.1 {ASIDE} 0" diaginertia="0.002 0.006 0.006"/>
</body></body></body></worldbody></mujoco>"""
NAMES = ("pan", "lift", "bend")
RATE, SECONDS = 50.0, 30.0


def joint_by_joint(
    folder: Path,
    mass: float = 0.0,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    zero: float = 0.0,
) -> Recording:
    """Return a recording with a load on the fore, kg and m, and a wrong zero of the bend, rad."""
    spec = mujoco.MjSpec.from_string(ROBOT)
    if mass:
        hung = spec.body("fore").add_body(mass=mass, ipos=at, inertia=[1e-9] * 3)
        hung.explicitinertial = True
    model = spec.compile()
    header = ",".join(["time", *(f"{n}.position" for n in NAMES), *(f"{n}.effort" for n in NAMES)])
    for number, name in enumerate(NAMES):
        table = _trial(model, number)
        table[:, len(NAMES)] += zero
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header=header, comments="")
    (folder / "robot.xml").write_text(ROBOT)
    trials = [{"file": f"{name}.csv", "group": name} for name in NAMES]
    session = {"schema": 1, "model": "robot.xml", "trials": trials}
    (folder / "session.json").write_text(json.dumps(session))
    return load_session(folder)


def all_at_once(folder: Path, seed: int) -> Recording:
    """Return one trial of the arm with friction, of which masses and motors are not known.

    Viscous friction of 0.2 to 1.5 Nm s/rad, Coulomb's of 0.2 to 1 Nm; links declared 0.3 to 2 times
    as heavy as they are, motors without inertia.
    """
    rng, time = np.random.default_rng(seed), np.arange(int(SECONDS * RATE)) / RATE
    angle, rate, rise = (np.zeros((len(NAMES), len(time))) for _ in range(3))
    for joint in range(len(NAMES)):
        for harmonic in (1, 2, 3):
            pace, size, phase = (
                2 * np.pi * 0.12 * harmonic,
                rng.uniform(0.1, 0.4),
                rng.uniform(0.0, 2 * np.pi),
            )
            angle[joint] += size * np.sin(pace * time + phase)
            rate[joint] += size * pace * np.cos(pace * time + phase)
            rise[joint] -= size * pace**2 * np.sin(pace * time + phase)
    viscous, coulomb = rng.uniform(0.2, 1.5, len(NAMES)), rng.uniform(0.2, 1.0, len(NAMES))
    effort = _needed(mujoco.MjModel.from_xml_string(ROBOT), angle, rate, rise)
    effort += viscous[:, None] * rate + coulomb[:, None] * np.tanh(rate / 0.02)
    effort += 0.05 * rng.standard_normal(effort.shape)
    table = np.vstack([time, angle, effort]).T
    header = ",".join(["time", *(f"{n}.position" for n in NAMES), *(f"{n}.effort" for n in NAMES)])
    np.savetxt(folder / "all.csv", table, delimiter=",", header=header, comments="")
    spec = mujoco.MjSpec.from_string(ROBOT)
    for body in spec.bodies[1:]:
        body.mass *= rng.uniform(0.3, 2.0)
    for joint in spec.joints:
        joint.armature = 0.0
    spec.compile()
    (folder / "robot.xml").write_text(spec.to_xml())
    session = {"schema": 1, "model": "robot.xml", "trials": [{"file": "all.csv"}]}
    (folder / "session.json").write_text(json.dumps(session))
    return load_session(folder)


def _trial(model: mujoco.MjModel, moved: int) -> np.ndarray:
    """Return time, angles and noisy efforts of a trial that moves one joint, (n, 7)."""
    rng = np.random.default_rng(moved)
    time = np.arange(int(SECONDS * RATE)) / RATE
    pace = 2 * np.pi * np.array([0.23, 0.61])[:, None]
    angle = np.tile([[0.0], [0.3], [-0.8]], len(time))
    rate, rise = np.zeros_like(angle), np.zeros_like(angle)
    angle[moved] += 0.35 * np.sin(pace * time).sum(axis=0)
    rate[moved] = 0.35 * (pace * np.cos(pace * time)).sum(axis=0)
    rise[moved] = -0.35 * (pace**2 * np.sin(pace * time)).sum(axis=0)
    effort = _needed(model, angle, rate, rise)
    return np.vstack([time, angle, effort + 0.02 * rng.standard_normal(effort.shape)]).T


def _needed(
    model: mujoco.MjModel, angle: np.ndarray, rate: np.ndarray, rise: np.ndarray
) -> np.ndarray:
    """Return the torques of a motion, all of shape (joints, n)."""
    data, effort = mujoco.MjData(model), np.empty_like(angle)
    for n in range(angle.shape[1]):
        data.qpos[:], data.qvel[:], data.qacc[:] = angle[:, n], rate[:, n], rise[:, n]
        mujoco.mj_inverse(model, data)
        effort[:, n] = data.qfrc_inverse
    return effort
