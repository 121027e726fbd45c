"""A load on an arm that moves one joint a trial hangs where the trials say, and no further."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.robot import weighed, with_ordinary
from analysis.closeloop.identification.arms.shared import with_share
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.load import load_session
from sim.effects.laws.inertia import PLACE

MASS, AT, ASIDE = 1.2, np.array([0.2, 0.0, 0.03]), -0.02
#: Only the pan axis, which may have other inertia, feels how far aside of the fore a load hangs.
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


def trial(model: mujoco.MjModel, moved: int) -> np.ndarray:
    """Return time, angles and noisy efforts of a trial that moves one joint, (n, 7)."""
    data, rng = mujoco.MjData(model), np.random.default_rng(moved)
    time = np.arange(int(SECONDS * RATE)) / RATE
    pace = 2 * np.pi * np.array([0.23, 0.61])[:, None]
    angle = np.tile([[0.0], [0.3], [-0.8]], len(time))
    rate, rise = np.zeros_like(angle), np.zeros_like(angle)
    angle[moved] += 0.35 * np.sin(pace * time).sum(axis=0)
    rate[moved] = 0.35 * (pace * np.cos(pace * time)).sum(axis=0)
    rise[moved] = -0.35 * (pace**2 * np.sin(pace * time)).sum(axis=0)
    effort = np.empty_like(angle)
    for n in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = angle[:, n], rate[:, n], rise[:, n]
        mujoco.mj_inverse(model, data)
        effort[:, n] = data.qfrc_inverse
    return np.vstack([time, angle, effort + 0.02 * rng.standard_normal(effort.shape)]).T


@pytest.fixture
def asked(tmp_path: Path) -> tuple[Model, Rows]:
    """Return a model with what each joint may have, and the rows; the load is not declared."""
    spec = mujoco.MjSpec.from_string(ROBOT)
    hung = spec.body("fore").add_body(mass=MASS, ipos=AT, inertia=[1e-9] * 3)
    hung.explicitinertial = True
    loaded = spec.compile()
    header = ",".join(["time", *(f"{n}.position" for n in NAMES), *(f"{n}.effort" for n in NAMES)])
    for number, name in enumerate(NAMES):
        table = trial(loaded, number)
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=header, comments="")
    (tmp_path / "robot.xml").write_text(ROBOT)
    trials = [{"file": f"{name}.csv", "group": name} for name in NAMES]
    session = {"schema": 1, "model": "robot.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(session))
    recording = load_session(tmp_path)
    rows = weighed(Model(recording), select_rows(recording, recording.fit_trials))
    return with_ordinary(Model(recording), rows), rows


def test_along_an_axis_that_no_trial_tells_it_stays_where_the_link_s_own_mass_is(
    asked: tuple[Model, Rows],
) -> None:
    model, rows = asked
    fit = WholeFit(model, rows, links_of(model.recording))
    load = min(fit.loads(), key=lambda one: one.loss)
    assert load.place is not None
    assert (load.link, load.told) == (2, (0, 2))
    assert load.mass == pytest.approx(MASS, rel=0.02)
    assert load.place == pytest.approx([AT[0], ASIDE, AT[2]], abs=0.01)


def test_it_is_named_and_later_steps_leave_it_there(asked: tuple[Model, Rows]) -> None:
    model, rows = asked
    shared = with_share(model, rows, links_of(model.recording), links_free=True)
    (load,) = [c for c in shared.effects if c not in model.effects]
    assert load.key == ("payload", 2)
    term = next(term for term in shared.terms if term.candidate == load)
    assert term.kept == (0, 1, 3) and term.theta[PLACE[1]] == pytest.approx(ASIDE)
