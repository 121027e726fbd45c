"""A repaired model is simulated along the recording, whatever of it was recorded."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.load import load_session
from analysis.closeloop.report.confirmation import simulate
from analysis.closeloop.session.device import Device

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
