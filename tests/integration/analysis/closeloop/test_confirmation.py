"""A repaired model is simulated along the recording, whatever of it was recorded."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from analysis.closeloop.load import load_session
from analysis.closeloop.report.confirmation import NEAR, confirm, simulate, unconfirmed
from analysis.closeloop.session.contents import AddedMass
from analysis.closeloop.session.device import Device
from sim.effects.catalogue import BY_NAME

#: A light link between joints of nearly one axis: what moves one shakes the other.
CHAIN = """<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 -1 0"/>
      <inertial pos="0.01 0 0" mass="0.2" diaginertia="2e-4 2e-4 2e-4"/>
      <body name="fore" pos="0.02 0 0">
        <joint name="elbow" axis="0 -1 0"/>
        <inertial pos="0.13 0 0" mass="1.4" diaginertia="0.003 0.01 0.01"/>
        <body name="hand" pos="0.25 0 0">
          <joint name="wrist" axis="0 -1 0"/>
          <inertial pos="0.2 0 0" mass="1" diaginertia="1e-4 1e-4 1e-4"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = ("shoulder", "elbow", "wrist")


@pytest.mark.parametrize("joint", JOINTS)
def test_a_chain_of_which_one_joint_has_an_effort_keeps_its_path(
    tmp_path: Path, joint: str
) -> None:
    time = np.arange(0.0, 4.0, 0.005)
    w = 2 * np.pi * np.array([0.5, 0.7, 0.9])
    centre = np.array([-0.4, 0.9, 0.4])
    position = centre + 0.4 * np.sin(w * time[:, None])
    motion = position, 0.4 * w * np.cos(w * time[:, None]), -(w**2) * (position - centre)
    device = Device(mujoco.MjSpec.from_string(CHAIN), ())
    effort = device.inverse_dynamics(*motion)[:, JOINTS.index(joint)]
    header = ",".join(["time", *(f"{name}.position" for name in JOINTS), f"{joint}.effort"])
    table = np.column_stack([time, position, effort])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    (tmp_path / "device.xml").write_text(CHAIN)
    session = {"schema": 1, "model": "device.xml", "trials": [{"file": "a.csv"}]}
    (tmp_path / "session.json").write_text(json.dumps(session))
    recording = load_session(tmp_path)
    (number,) = recording.joints
    run = simulate(recording, CHAIN, recording.slices[0])
    assert run.finite
    assert run.deviation[number] < 0.02
    assert run.feedback[number] < 0.1 * float(np.sqrt(np.mean(effort**2)))


LINK = """<mujoco><worldbody><body name="fore"><joint name="elbow" axis="0 -1 0"/>
  <inertial pos="0.13 0 0" mass="1.4" diaginertia="0.003 0.01 0.01"/></body></worldbody></mujoco>
"""


@pytest.mark.parametrize("named", [True, False])
def test_a_trial_is_simulated_with_what_it_carries(tmp_path: Path, named: bool) -> None:
    time = np.arange(0.0, 2.0, 0.005)
    angle = 0.4 * np.sin(5.0 * time)
    motion = (each[:, None] for each in (angle, 2.0 * np.cos(5.0 * time), -25.0 * angle))
    load = AddedMass(body="fore", mass=0.5, position=(0.25, 0.0, 0.0))
    device = Device(mujoco.MjSpec.from_string(LINK), ())
    effort = device.inverse_dynamics(*motion, masses=(load,))[:, 0]
    table = np.column_stack([time, angle, effort])
    header = "time,elbow.position,elbow.effort"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    (tmp_path / "device.xml").write_text(LINK)
    trial = {"file": "a.csv"} | ({"payload": {"name": "weight", "body": "fore"}} if named else {})
    session = {"schema": 1, "model": "device.xml", "trials": [trial]}
    (tmp_path / "session.json").write_text(json.dumps(session))
    # Too light before the repair; as it is after it.
    parameters = {
        "mass": {"before": 0.3, "value": load.mass},
        "position": {"before": [0.2, 0.0, 0.0], "value": list(load.position)},
    }
    declared = {"effect": "payload", "name": "weight", "body": "fore", "parameters": parameters}
    unnamed = {"file": "a.csv", "from": 0.0, "to": 1.995, "body": "fore", **parameters}
    report = {
        "impedance": {},
        "declared": [declared] if named else [],
        "unnamed_loads": [] if named else [unnamed],
    }
    confirmation, simulation = confirm(load_session(tmp_path), report, LINK)
    (entry,) = confirmation["joints"].values()
    assert entry["feedback_after"] < 0.02 * float(np.sqrt(np.mean(effort**2)))
    # A load that no trial names is none of the declared model's: it hangs there before and after.
    assert (entry["feedback_after"] < 0.1 * entry["feedback_before"]) is named
    assert simulation["joints"]["elbow"]["open_loop"]["after"] < 0.02


#: A light link whose motor's inertia nobody declared, fifty times its own.
LIGHT = LINK.replace(
    'mass="1.4" diaginertia="0.003 0.01 0.01"', 'mass="0.02" diaginertia="1e-5 1e-5 1e-5"'
)


@pytest.mark.parametrize(("armature", "hertz"), [(0.0, 2.0), (0.004, 4.0)])
def test_a_right_repair_of_a_light_link_is_confirmed_near_its_path(
    tmp_path: Path, armature: float, hertz: float
) -> None:
    """At 2 Hz what is left of the motor's torque throws the link far off, friction or none."""
    time = np.arange(0.0, 4.0, 0.005)
    angle, velocity = 0.4 * np.sin(5.0 * time), 2.0 * np.cos(5.0 * time)
    motion = (each[:, None] for each in (angle, velocity, -25.0 * angle))
    needed = Device(mujoco.MjSpec.from_string(LIGHT), ()).inverse_dynamics(*motion)[:, 0]
    effort = needed + 0.3 * np.tanh(velocity / 0.02) - 25.0 * armature * angle
    table = np.column_stack([time, angle, effort])
    header = "time,elbow.position,elbow.effort"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    (tmp_path / "device.xml").write_text(LIGHT)
    session = {"schema": 1, "model": "device.xml", "trials": [{"file": "a.csv"}]}
    (tmp_path / "session.json").write_text(json.dumps(session))
    repaired = LIGHT.replace('name="elbow"', 'name="elbow" frictionloss="0.3"')
    report: dict[str, Any] = {"impedance": {}, "declared": [], "unnamed_loads": []}
    confirmation, _ = confirm(load_session(tmp_path), report, repaired)
    (entry,) = confirmation["joints"].values()
    assert confirmation["bandwidth_hz"] == pytest.approx(hertz)
    assert entry["deviation_after"] < NEAR
    assert unconfirmed(confirmation, {"elbow"}) == []


def test_a_drift_is_simulated_by_the_session_s_clock(tmp_path: Path) -> None:
    """The second trial begins a minute after the first, not at the drift's beginning."""
    values = {"rate": 0.01, "time_constant": 200.0, "torque_at_start": 0.1}
    swing, efforts = np.arange(0.0, 2.0, 0.005), []
    angle = 0.4 * np.sin(5.0 * swing)
    motion = [each[:, None] for each in (angle, 2.0 * np.cos(5.0 * swing), -25.0 * angle)]
    needed = Device(mujoco.MjSpec.from_string(LINK), ()).inverse_dynamics(*motion)[:, 0]
    for file, begun in (("a.csv", 5.0), ("b.csv", 65.0)):
        since = begun - 5.0 + swing
        drift = values["torque_at_start"] + 2.0 * (1.0 - np.exp(-since / 200.0))
        efforts.append(drift)
        table = np.column_stack([begun + swing, angle, needed + drift])
        header = "time,elbow.position,elbow.effort"
        np.savetxt(tmp_path / file, table, delimiter=",", header=header, comments="", fmt="%.9g")
    (tmp_path / "device.xml").write_text(LINK)
    trials = [{"file": "a.csv"}, {"file": "b.csv"}]
    session = {"schema": 1, "model": "device.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(session))
    spec = mujoco.MjSpec.from_string(LINK)
    BY_NAME["drift"].add(spec, "elbow", values)
    recording = load_session(tmp_path)
    for piece, drift in zip(recording.slices, efforts, strict=True):
        run = simulate(recording, spec.to_xml(), piece)
        assert run.feedback[0] < 0.1 * float(np.sqrt(np.mean(drift**2)))


@pytest.mark.parametrize(
    ("feedback", "deviation", "repaired", "warned"),
    [
        (6.499, 1e-3, True, False),
        # Of an opponent: noise takes the same feedback, and the joint stays ten times nearer.
        (6.5, 5e-4, True, False),
        (6.5, 5e-3, True, True),
        # Nothing was found there, so nothing has to be better.
        (6.51, 5e-3, False, False),
        (7.0, 5e-4, False, True),
        (7.0, 5e-4, True, True),
    ],
)
def test_a_repair_has_to_help_its_own_joint_and_to_harm_no_other(
    feedback: float, deviation: float, repaired: bool, warned: bool
) -> None:
    before = {"feedback_before": 6.5, "deviation_before": 5e-3, "unit": "Nm"}
    entry = before | {"feedback_after": feedback, "deviation_after": deviation}
    confirmation: dict[str, Any] = {"ran": True, "joints": {"elbow": entry}}
    assert bool(unconfirmed(confirmation, {"elbow"} if repaired else set())) is warned
    lost = entry | {"feedback_before": np.nan, "deviation_before": np.nan}
    assert unconfirmed({"ran": True, "joints": {"elbow": lost}}, {"elbow"}) == []
