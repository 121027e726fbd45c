"""A declared load is as heavy as its inertia says, wherever the steps to its place begin."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.arms.spread import mass_and_place
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.load import load_session
from analysis.closeloop.report.shared import payload_entries

#: Two joints, the first of which turns about the vertical: gravity says only the load's moments.
ROBOT = """<mujoco><compiler angle="radian"/><worldbody>
<body name="turret" pos="0 0 0.2"><joint name="pan" axis="0 0 1" armature="0.1"/>
<inertial mass="4" pos="0 0 0.1" fullinertia="0.03 0.03 0.01 0 0 0"/>
<body name="arm" pos="0 -0.02 0.3" euler="-0.2 0.3 0">
<joint name="lift" axis="0 1 0" armature="0.07"/>
<inertial mass="4.5" pos="0.12 0 0.01" fullinertia="0.006 0.037 0.037 0 0 0"/>
</body></body></worldbody></mujoco>"""
#: The same with an elbow: of three joints, the lift alone weighs the load.
ELBOW = """<body name="fore" pos="0.26 0 0"><joint name="bend" axis="0 1 0" armature="0.02"/>
<inertial mass="1.5" pos="0.1 0 0.01" fullinertia="0.002 0.006 0.006 0 0 0"/></body>"""
THREE = ROBOT.replace("</body></body></worldbody>", ELBOW + "</body></body></worldbody>")
#: The lift alone.
ONE = """<mujoco><compiler angle="radian"/><worldbody>
<body name="arm"><joint name="lift" axis="0 1 0" armature="0.07"/>
<inertial mass="4.5" pos="0.12 0 0.01" fullinertia="0.006 0.037 0.037 0 0 0"/>
</body></worldbody></mujoco>"""
MASS, PLACE = 0.6, np.array([0.15, 0.04, 0.05])
RATE, SECONDS = 50.0, 8.0


def trial(robot: str, body: str, mass: float, seed: int, pace: float, inertia: float) -> np.ndarray:
    """Return time, angles and efforts of one trial, (n, 1 + 2 joints)."""
    spec = mujoco.MjSpec.from_string(robot)
    if mass:
        carried = spec.body(body).add_body(mass=mass, ipos=PLACE, inertia=[inertia] * 3)
        carried.explicitinertial = True
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    time = np.arange(int(SECONDS * RATE)) / RATE
    w = 2 * np.pi * pace * rng.uniform(0.3, 0.9, (model.nv, 1))
    phase = w * time + rng.uniform(0, 6, (model.nv, 1))
    motion = (0.6 * np.sin(phase), 0.6 * w * np.cos(phase), -0.6 * w**2 * np.sin(phase))
    effort = np.empty((len(time), model.nv))
    for n in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = (part[:, n] for part in motion)
        mujoco.mj_inverse(model, data)
        effort[n] = data.qfrc_inverse
    noise = 0.005 * rng.standard_normal(effort.shape)
    return np.column_stack([time, motion[0].T, effort + noise])


def written(
    folder: Path,
    robot: str,
    body: str,
    mass: float = MASS,
    rub: float = 0.0,
    pace: float = 1.0,
    inertia: float = 1e-9,
) -> Path:
    """Write a session of two trials, the second with the load; Nm `rub` at the first joint."""
    model = mujoco.MjModel.from_xml_string(robot)
    names = [model.joint(number).name for number in range(model.njnt)]
    header = ",".join(["time", *(f"{n}.position" for n in names), *(f"{n}.effort" for n in names)])
    for number, hung in enumerate((0.0, mass)):
        table = trial(robot, body, hung, number, pace, inertia)
        table[:, 1 + model.njnt] += rub * np.sign(np.gradient(table[:, 1]))
        np.savetxt(folder / f"{number}.csv", table, delimiter=",", header=header, comments="")
    (folder / "robot.xml").write_text(robot)
    carried = {"file": "1.csv", "payload": {"name": "tool", "body": body}}
    session = {"schema": 1, "model": "robot.xml", "trials": [{"file": "0.csv"}, carried]}
    (folder / "session.json").write_text(json.dumps(session))
    return folder


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return written(tmp_path, ROBOT, "arm")


def test_a_load_that_only_inertia_weighs_is_not_a_heavy_one_near_its_joint(session: Path) -> None:
    """Steps that begin at the link's origin end at tons, a few hairs from it."""
    recording = load_session(session)
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    (term,) = model.terms
    own = evaluate(model, rows).coefficients
    mass, *place = mass_and_place(model, term, own[None])[0].tolist()
    assert mass == pytest.approx(MASS, rel=0.05)
    assert place == pytest.approx(PLACE.tolist(), abs=0.01)


@pytest.mark.parametrize("mass", [MASS, 0.0])
def test_a_load_that_one_joint_weighs_is_known_as_well_as_that_joint_knows_it(
    mass: float, tmp_path: Path
) -> None:
    """Without it a vertical axis that rubs, and the last joint, weigh the load at anything."""
    recording = load_session(written(tmp_path, THREE, "fore", mass, rub=0.2, pace=0.4))
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    fit = (model, evaluate(model, rows).coefficients)
    (entry,) = payload_entries((fit, fit), rows)
    low, high = entry["parameters"]["mass"]["ci90"]
    assert low <= mass and mass <= high < mass + 0.1
    assert mass == 0.0 or low > 0.5


@pytest.mark.parametrize("inertia", [1e-9, 0.02])
def test_a_declared_load_has_an_inertia_of_its_own_if_the_joints_tell_it(
    inertia: float, tmp_path: Path
) -> None:
    recording = load_session(written(tmp_path, THREE, "fore", inertia=inertia, pace=2.0))
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    fit = (model, evaluate(model, rows).coefficients)
    (entry,) = payload_entries((fit, fit), rows)
    assert entry["parameters"]["mass"]["value"] == pytest.approx(MASS, rel=0.03)
    assert entry["parameters"]["inertia"]["value"] == pytest.approx(inertia, rel=0.1, abs=1e-3)


def test_an_inertia_that_one_joint_cannot_tell_from_the_mass_is_not_fitted(tmp_path: Path) -> None:
    recording = load_session(written(tmp_path, ONE, "arm"))
    rows = select_rows(recording, recording.fit_trials)
    model = declared_model(recording, rows)
    fit = (model, evaluate(model, rows).coefficients)
    (entry,) = payload_entries((fit, fit), rows)
    assert entry["parameters"]["inertia"]["value"] is None
    assert "do not determine it" in entry["parameters"]["inertia"]["refused"]
