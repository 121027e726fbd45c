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

#: Two joints, the first of which turns about the vertical: gravity says only the load's moments.
ROBOT = """<mujoco><compiler angle="radian"/><worldbody>
<body name="turret" pos="0 0 0.2"><joint name="pan" axis="0 0 1" armature="0.1"/>
<inertial mass="4" pos="0 0 0.1" fullinertia="0.03 0.03 0.01 0 0 0"/>
<body name="arm" pos="0 -0.02 0.3" euler="-0.2 0.3 0">
<joint name="lift" axis="0 1 0" armature="0.07"/>
<inertial mass="4.5" pos="0.12 0 0.01" fullinertia="0.006 0.037 0.037 0 0 0"/>
</body></body></worldbody></mujoco>"""
MASS, PLACE = 0.6, np.array([0.15, 0.04, 0.05])
RATE, SECONDS = 50.0, 8.0


def trial(load: bool, seed: int) -> np.ndarray:
    """Return time, angles and efforts of one trial, (n, 5)."""
    spec = mujoco.MjSpec.from_string(ROBOT)
    if load:
        carried = spec.body("arm").add_body(mass=MASS, ipos=PLACE, inertia=[1e-9] * 3)
        carried.explicitinertial = True
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    time = np.arange(int(SECONDS * RATE)) / RATE
    w = 2 * np.pi * rng.uniform(0.3, 0.9, (2, 1))
    phase = w * time + rng.uniform(0, 6, (2, 1))
    motion = (0.6 * np.sin(phase), 0.6 * w * np.cos(phase), -0.6 * w**2 * np.sin(phase))
    effort = np.empty((len(time), 2))
    for n in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = (part[:, n] for part in motion)
        mujoco.mj_inverse(model, data)
        effort[n] = data.qfrc_inverse
    noise = 0.005 * rng.standard_normal(effort.shape)
    return np.column_stack([time, motion[0].T, effort + noise])


@pytest.fixture
def session(tmp_path: Path) -> Path:
    names = "time,pan.position,lift.position,pan.effort,lift.effort"
    for number, load in enumerate((False, True)):
        np.savetxt(
            tmp_path / f"{number}.csv",
            trial(load, number),
            delimiter=",",
            header=names,
            comments="",
        )
    (tmp_path / "robot.xml").write_text(ROBOT)
    carried = {"file": "1.csv", "payload": {"name": "tool", "body": "arm"}}
    written = {"schema": 1, "model": "robot.xml", "trials": [{"file": "0.csv"}, carried]}
    (tmp_path / "session.json").write_text(json.dumps(written))
    return tmp_path


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
