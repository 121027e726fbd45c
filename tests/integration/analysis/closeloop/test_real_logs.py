"""What robots' own logs and models have: read as it is where it harms nothing, and said."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.loop import close_loop
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.small import HEADER, rows
from tests.testbed.sessions.synthetic import mjcf

ARM = Arm()
#: The testbed's arm as a robot's maker would ship it.
URDF = f"""<robot name="arm">
  <gazebo><plugin name="driver" filename="libdriver.so"/></gazebo>
  <link name="base"/>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
  </joint>
  <link name="upper">
    <visual><geometry><mesh filename="package://arm/upper.stl"/></geometry></visual>
    <collision><geometry><mesh filename="package://arm/upper.stl"/></geometry></collision>
    <inertial><origin xyz="0.15 0 0"/><mass value="2"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="forearm"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 -1 0"/>
  </joint>
  <link name="forearm">
    <inertial><origin xyz="{ARM.lever} 0 0"/><mass value="{ARM.mass}"/>
      <inertia ixx="0.01" iyy="{ARM.inertia - ARM.mass * ARM.lever**2}" izz="0.01"
               ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="flange" type="fixed">
    <parent link="forearm"/><child link="tool"/><origin xyz="0.25 0 0"/>
  </joint>
  <link name="tool"/>
</robot>
"""


def written(
    folder: Path, table: np.ndarray, *, model: str = "", text: str = "", **session: object
) -> Path:
    """Write a session of one file; `session` replaces entries of `session.json`."""
    folder.mkdir(exist_ok=True)
    (folder / "device.xml").write_text(model or mjcf(ARM))
    lines = [",".join(f"{x:.7g}" for x in row) for row in table]
    (folder / "a.csv").write_text(text or "\n".join([HEADER, *lines]) + "\n")
    content = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}],
        "trials": [{"file": "a.csv"}],
    }
    (folder / "session.json").write_text(json.dumps(content | session))
    return folder


def repairs(recording: Recording) -> tuple[str, ...]:
    return recording.session.trials[0].repairs


def test_a_urdf_file_with_meshes_and_drivers_is_the_same_arm(tmp_path: Path) -> None:
    ours = load_session(written(tmp_path / "a", rows()))
    theirs = load_session(written(tmp_path / "b", rows(), model=URDF))
    assert theirs.device.joints == ("shoulder", "elbow")
    assert {"base", "forearm", "tool"} <= set(theirs.device.bodies)
    assert theirs.inverse[:, 1] == pytest.approx(ours.inverse[:, 1], abs=1e-9)


def test_a_link_whose_inertia_no_body_has_is_told_of(tmp_path: Path) -> None:
    """Before, MuJoCo refused it; public robots' files have such links."""
    odd = URDF.replace('ixx="0.01" iyy="0.02" izz="0.02"', 'ixx="0.01" iyy="0.02" izz="0.05"')
    recording = load_session(written(tmp_path / "a", rows(), model=odd))
    (remark,) = recording.device.remarks
    assert remark.startswith("no body has the inertia of upper")


def test_meshes_of_an_mjcf_file_are_left_out_and_its_inertias_kept(tmp_path: Path) -> None:
    drawn = mjcf(ARM).replace(
        "<worldbody>",
        '<asset><mesh name="m" file="far/away.stl"/>'
        '<texture name="t" type="2d" file="skin.png"/><material name="s" texture="t"/></asset>'
        '<worldbody><geom type="mesh" mesh="m" material="s"/>',
    )
    drawn = drawn.replace(
        '<joint name="elbow"', '<geom type="mesh" mesh="m" material="s"/><joint name="elbow"'
    )
    ours = load_session(written(tmp_path / "a", rows()))
    theirs = load_session(written(tmp_path / "b", rows(), model=drawn))
    assert np.array_equal(theirs.inverse, ours.inverse)


def test_a_joint_without_limits_may_turn_more_than_once(tmp_path: Path) -> None:
    table = rows()
    table[:, 2] += 5 * 2 * np.pi
    recording = load_session(written(tmp_path / "a", table, declared_effects=[]))
    assert recording.position[:, 1].min() > 30.0


@pytest.mark.parametrize("limb", [{}, {"declared_effects": [], "limb_joints": ["elbow"]}])
def test_a_limb_may_not(tmp_path: Path, limb: dict[str, object]) -> None:
    table = rows()
    table[:, 2] += 5 * 2 * np.pi
    with pytest.raises(SessionError, match="no limb does"):
        load_session(written(tmp_path / "a", table, **limb))


def test_degrees_of_a_joint_without_limits_show_by_its_speed(tmp_path: Path) -> None:
    table = np.delete(rows(), 3, axis=1)
    table[:, 2] = np.degrees(table[:, 2])
    text = HEADER.replace("elbow.velocity,", "") + "\n"
    text += "\n".join(",".join(f"{x:.7g}" for x in row) for row in table) + "\n"
    with pytest.raises(SessionError, match="degrees"):
        load_session(written(tmp_path / "a", table, text=text, declared_effects=[]))


def test_a_copied_sample_and_an_empty_cell_are_left_out_and_said(tmp_path: Path) -> None:
    table = rows()
    table[500] = table[499]
    lines = [",".join(f"{x:.7g}" for x in row) for row in table]
    lines[900] = lines[900].rpartition(",")[0] + ","
    text = "\n".join([HEADER, *lines]) + "\n"
    recording = load_session(written(tmp_path / "a", table, text=text))
    assert repairs(recording) == (
        "1 sample with an empty cell was left out",
        "1 sample that repeats the one before was left out",
    )
    assert len(recording.session.trials[0].time) == len(table) - 2


def test_a_stamp_that_comes_again_with_other_values_is_refused_by_line(tmp_path: Path) -> None:
    table = rows()
    table[500, 0] = table[499, 0]
    table[100] = table[99]
    with pytest.raises(SessionError, match="must increase") as refused:
        load_session(written(tmp_path / "a", table))
    assert refused.value.line == 502 and "begins anew" not in str(refused.value)


def test_a_clock_that_begins_anew_is_told_as_another_trial(tmp_path: Path) -> None:
    table = rows()
    table[500:, 0] -= table[500, 0]
    with pytest.raises(SessionError, match=r"begins anew .* another trial, cut") as refused:
        load_session(written(tmp_path / "a", table))
    assert refused.value.line == 502


@pytest.mark.parametrize(("value", "told"), [(0.7, True), (0.0, False)])
def test_an_effort_that_is_stuck_while_its_joint_moves_is_told(
    tmp_path: Path, value: float, told: bool
) -> None:
    """A stranger tried it. At zero the motor may be off, and somebody moves the joint."""
    table = rows()
    effort = HEADER.split(",").index("elbow.effort")
    table[:, effort] += 0.01 * np.random.default_rng(0).standard_normal(len(table))
    assert repairs(load_session(written(tmp_path / "a", table))) == ()
    table[200:500, effort] = value
    said = repairs(load_session(written(tmp_path / "b", table)))
    assert any("stays at 0.7 for 300 samples while the joint moves" in s for s in said) == told


@pytest.mark.parametrize("fault", ["copies", "empty cells"])
def test_more_than_one_sample_in_a_hundred_is_an_error(tmp_path: Path, fault: str) -> None:
    table = rows()
    if fault == "copies":
        table[1:90:2] = table[0:89:2]
    lines = [",".join(f"{x:.7g}" for x in row) for row in table]
    if fault == "empty cells":
        lines[10:40] = [line.rpartition(",")[0] + "," for line in lines[10:40]]
    text = "\n".join([HEADER, *lines]) + "\n"
    with pytest.raises(SessionError, match="at most 1% may be left out") as refused:
        load_session(written(tmp_path / "a", table, text=text))
    assert refused.value.line == (3 if fault == "copies" else 12)


def test_a_file_that_ends_in_the_middle_of_a_line(tmp_path: Path) -> None:
    lines = [",".join(f"{x:.7g}" for x in row) for row in rows()]
    text = "\n".join([HEADER, *lines]) + "\n10.0,-0.4,1.2"
    recording = load_session(written(tmp_path / "a", rows(), text=text))
    assert repairs(recording) == ("line 2002 is cut off, and was left out",)


def test_a_log_without_a_header_keeps_its_first_sample(tmp_path: Path) -> None:
    lines = [",".join(f"{x:.7g}" for x in row) for row in rows()]
    text = "\n".join(lines) + "\n10.0,-0.4"
    columns = {name: number for number, name in enumerate(HEADER.split(","), start=1)}
    folder = written(tmp_path / "a", rows(), text=text, columns={"map": columns})
    recording = load_session(folder)
    assert len(recording.session.trials[0].time) == len(rows())
    assert repairs(recording) == ("line 2001 is cut off, and was left out",)


def test_one_recording_serves_several_trials(tmp_path: Path) -> None:
    trials = [
        {"file": "a.csv", "from": 0.0, "to": 4.0},
        {"file": "a.csv", "from": 4.5, "role": "holdout"},
    ]
    recording = load_session(written(tmp_path / "a", rows(), trials=trials))
    first, second = recording.session.trials
    assert first.time[-1] == pytest.approx(4.0) and second.time[0] == pytest.approx(4.5)
    assert first.group != second.group and recording.fit_trials == (0,)


@pytest.mark.parametrize(
    ("trials", "words"),
    [
        ([{"file": "a.csv", "from": 3.0, "to": 2.0}], "must be before to"),
        ([{"file": "a.csv", "from": "now"}], "must be a finite number"),
        ([{"file": "a.csv", "to": 5.0}, {"file": "a.csv", "from": 4.0}], "listed twice"),
        ([{"file": "a.csv", "from": 100.0}], "0 samples from 100 s; at least 50 are needed"),
    ],
)
def test_a_wrong_part_of_a_file_is_one_sentence(
    tmp_path: Path, trials: list[dict[str, object]], words: str
) -> None:
    with pytest.raises(SessionError, match=words):
        load_session(written(tmp_path / "a", rows(), trials=trials))


def test_friction_that_a_held_joint_lets_go_is_nothing_unexplained(tmp_path: Path) -> None:
    """A Staubli TX40 held still after its held-out movements: friction at rest has any value."""
    joint = '<joint name="elbow" axis="0 -1 0"/>'
    body = (
        f'<body name="forearm">{joint}<geom type="sphere" size=".1" mass="2" pos=".2 0 0"/></body>'
    )
    rng, time = np.random.default_rng(5), np.arange(0.0, 20.0, 0.005)
    w = 2 * np.pi * np.array([0.4, 0.9])
    trials = []
    for name, phase, role in (("a", 0.0, "fit"), ("b", 1.0, "fit"), ("c", 2.0, "holdout")):
        angle = (np.array([0.5, 0.2]) * np.sin(time[:, None] * w + phase)).sum(axis=1)
        if role == "holdout":
            # It stops where it would have turned around.
            angle = 0.6 * np.sin(2 * np.pi * 0.5 * np.minimum(time, 12.5))
        speed = np.gradient(angle, 0.005)
        load = 2.0 * (0.04 + 0.4 * 0.01) * np.gradient(speed, 0.005) + 2.0 * 9.81 * 0.2 * np.cos(
            angle
        )
        rubbing = 1.5 * np.tanh(speed / 0.05)
        if role == "holdout":
            held = time > 12.5
            rubbing[held] = 1.5 * np.exp(-(time[held] - 12.5))
        effort = load + rubbing + 0.02 * rng.standard_normal(len(time))
        np.savetxt(
            tmp_path / f"{name}.csv",
            np.column_stack([time, angle, effort]),
            delimiter=",",
            header="time,elbow.position,elbow.effort",
            comments="",
        )
        trials.append({"file": f"{name}.csv", "role": role})
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    content = {"schema": 1, "model": "arm.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(content))
    report = close_loop(tmp_path, tmp_path / "out")
    assert [effect["name"] for effect in report["effects"]] == ["coulomb_friction"]
    assert report["unexplained"] == {}
    # It is in the error of the table all the same, and that is said.
    (said,) = [line for line in report["warnings"] if line.startswith("elbow: its error after")]
    assert "% of its power is where the joint rests or turns around" in said
