"""A first session that the reader of sessions takes, and what is left to settle."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.assignment import assigned, of_factors
from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.draft import of_currents, write_session
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.joints import (
    joint_names,
    joints_in,
    of_only_joint,
    of_order,
    of_other_joints,
    of_parted_joints,
)
from analysis.closeloop.logs.log import Channel, Log

TIME = np.arange(0.0, 4.0, 0.01)


def beliefs(**more: np.ndarray) -> list[Belief]:
    arrays = {"t": TIME, "q": np.sin(TIME), "u": np.cos(TIME), **more}
    return believe(Log(kind="CSV", channels=[Channel(name=n, values=v) for n, v in arrays.items()]))


def table(path: Path) -> tuple[list[str], np.ndarray]:
    header, *_ = path.read_text().splitlines()
    return header.split(","), np.loadtxt(path, delimiter=",", skiprows=1)


def test_a_current_becomes_a_torque_by_what_the_user_says(tmp_path: Path) -> None:
    chosen, joints = assigned(beliefs(), ["u=elbow.effort*2.5", "q=elbow.position"])
    assert write_session(tmp_path / "s", "log", chosen, joints) == [
        "put the robot's MJCF or URDF into the folder as robot.xml"
    ]
    header, numbers = table(tmp_path / "s" / "log.csv")
    assert header == ["time", "elbow.position", "elbow.effort"]
    assert numbers[:, 2] == pytest.approx(2.5 * np.cos(TIME), abs=1e-8)
    session = json.loads((tmp_path / "s" / "session.json").read_text())
    assert session == {"schema": 1, "model": "robot.xml", "trials": [{"file": "log.csv"}]}


def test_samples_without_a_number_and_repeated_stamps_are_left_out_and_counted(
    tmp_path: Path,
) -> None:
    time, torque = TIME.copy(), np.cos(TIME)
    time[100], torque[200] = time[99], np.nan
    chosen = believe(
        Log(
            kind="CSV",
            channels=[
                Channel(name="t", values=time),
                Channel(name="q", values=np.sin(TIME)),
                Channel(name="torque_Nm", values=torque),
            ],
        )
    )
    remarks = write_session(tmp_path / "s", "log", chosen, joint_names(chosen))
    assert any("1 sample without a number" in remark for remark in remarks)
    assert any("1 sample that repeats a stamp was left out" in remark for remark in remarks)
    assert len(table(tmp_path / "s" / "log.csv")[1]) == len(TIME) - 2


def test_a_clock_that_begins_anew_begins_a_trial(tmp_path: Path) -> None:
    chosen = believe(
        Log(
            kind="CSV",
            channels=[
                Channel(name="t", values=np.concatenate([TIME, TIME])),
                Channel(name="q", values=np.tile(np.sin(TIME), 2)),
                Channel(name="torque_Nm", values=np.tile(np.cos(TIME), 2)),
            ],
        )
    )
    remarks = write_session(tmp_path / "s", "log", chosen, joint_names(chosen))
    assert any("begins anew 1 time:" in remark for remark in remarks)
    first, second = (table(tmp_path / "s" / f"log_{n}.csv")[1][:, 0] for n in (1, 2))
    assert len(first) == len(second) == len(TIME)
    assert second[0] == pytest.approx(first[-1] + 1.0)


def test_a_model_names_the_joints_of_a_log_without_names_and_is_copied(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    chosen, _ = assigned(beliefs(), ["u=joint_1.effort"])
    joints = joint_names(chosen, ["shoulder"])
    write_session(tmp_path / "s", "log", chosen, joints, tmp_path / "arm.urdf")
    assert (tmp_path / "s" / "arm.urdf").read_text() == "<robot/>"
    assert "shoulder.position" in table(tmp_path / "s" / "log.csv")[0]


def test_joints_of_a_urdf_are_not_those_of_its_transmissions_and_simulators(tmp_path: Path) -> None:
    """A UR10e's had twelve, so that its log's six had numbers for names; a PR2's 13 too many."""
    joint = '<joint name="elbow" type="revolute"/>'
    more = """<transmission><joint name="elbow"/></transmission>
    <gazebo><joint name="screw" type="revolute"/></gazebo>"""
    (tmp_path / "arm.urdf").write_text(f"<robot>{joint}{more}</robot>")
    assert joints_in(tmp_path / "arm.urdf") == ["elbow"]


def test_joints_of_an_mjcf_model_are_those_of_its_bodies(tmp_path: Path) -> None:
    elbow, ball = '<joint name="elbow"/>', '<joint name="wrist" type="ball"/>'
    bodies = f"<body>{elbow}<body>{ball}</body></body>"
    ties = '<equality><joint name="tie" joint1="elbow"/></equality>'
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody>{ties}</mujoco>")
    assert joints_in(tmp_path / "arm.xml") == ["elbow"]


def test_joints_that_the_log_does_not_show_are_ignored_in_the_session(tmp_path: Path) -> None:
    """A stranger's arm has fingers, and its session was refused for want of their positions."""
    finger = '<joint name="finger" type="slide"/><body><joint name="elbow"/></body>'
    shut = '<equality><joint name="shut" joint1="finger"/></equality>'
    model = tmp_path / "arm.xml"
    model.write_text(f"<mujoco><worldbody><body>{finger}</body></worldbody>{shut}</mujoco>")
    chosen = a_log(t=TIME, elbow_pos=np.sin(TIME), elbow_torque=np.cos(TIME))
    remarks = write_session(tmp_path / "s", "log", chosen, joint_names(chosen), model)
    assert json.loads((tmp_path / "s" / "session.json").read_text())["ignored_joints"] == ["finger"]
    assert any("no position of finger" in remark for remark in remarks)
    # A joint of another name may be any of the model's.
    other = a_log(t=TIME, wrist_pos=np.sin(TIME), wrist_torque=np.cos(TIME))
    write_session(tmp_path / "o", "log", other, joint_names(other), model)
    assert "ignored_joints" not in json.loads((tmp_path / "o" / "session.json").read_text())


def test_what_the_log_does_not_name_is_of_no_joint_beside_the_models(
    tmp_path: Path,
) -> None:
    """A stranger's fifty columns: of what was left, two became joints that the robot has not."""
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="elbow"/></body></worldbody></mujoco>'
    )
    columns = [np.sin(TIME), np.cos(TIME), np.sin(2 * TIME), 2 * np.cos(2 * TIME), TIME**2]
    chosen = a_log(**{f"column {n}": x for n, x in enumerate([TIME, *columns], start=1)})
    said = ["column 2=elbow.position", "column 6=elbow.effort"]
    chosen, joints = assigned(chosen, said, ["elbow"])
    left, *_ = write_session(tmp_path / "s", "log", chosen, joints, tmp_path / "arm.xml")
    assert left == "column 4, column 5: of no joint of the model, and left out"
    assert table(tmp_path / "s" / "log.csv")[0] == [
        *("time", "elbow.position", "elbow.velocity", "elbow.effort")
    ]


def test_a_clock_can_be_named(tmp_path: Path) -> None:
    log = Log(
        kind="CSV",
        channels=[
            Channel(name="a", values=1e4 * TIME),
            Channel(name="angle", values=np.sin(TIME)),
            Channel(name="torque_Nm", values=np.cos(TIME)),
        ],
    )
    chosen, _ = assigned(believe(log), ["a=time*1e-4"])
    write_session(tmp_path / "s", "log", chosen, joint_names(chosen))
    assert table(tmp_path / "s" / "log.csv")[1][:, 0] == pytest.approx(TIME)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("u", "no assignment"),
        ("nobody=elbow.effort", "no assignment"),
        ("u=elbow.voltage", "voltage"),
        ("u=elbow.effort*much", "no number"),
    ],
)
def test_a_wrong_assignment_is_one_sentence(line: str, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        assigned(beliefs(), [line])


def test_no_effort_and_a_folder_with_files_are_refused_and_nothing_is_written(
    tmp_path: Path,
) -> None:
    with pytest.raises(SessionError, match="no effort is known"):
        write_session(tmp_path / "s", "log", beliefs(), ["joint_1"])
    assert not (tmp_path / "s").exists()
    chosen, _ = assigned(beliefs(), ["u=joint_1.effort"])
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.doc").touch()
    with pytest.raises(SessionError, match="not an empty folder"):
        write_session(tmp_path / "full", "log", chosen, ["joint_1"])


def test_stamps_since_1970_keep_their_digits(tmp_path: Path) -> None:
    time = 1.6e9 + np.arange(400) * 0.002
    channels = [
        Channel(name="elbow.position", time=time, values=np.sin(TIME), unit="rad"),
        Channel(name="elbow.effort", time=time, values=np.cos(TIME), unit="Nm"),
    ]
    chosen = believe(Log(kind="ROS bag", channels=channels))
    assert write_session(tmp_path / "s", "log", chosen, joint_names(chosen), None)
    assert np.array_equal(table(tmp_path / "s" / "log.csv")[1][:, 0], time)


def test_a_name_that_ends_as_one_joint_of_the_model_does_means_that(tmp_path: Path) -> None:
    """A plotter writes /joints/j1/position."""
    named = {"/joints/j1/position": np.sin(TIME), "/joints/j12/position": np.cos(TIME)}
    log = [Channel(name=n, values=v) for n, v in {"t": TIME, **named}.items()]
    found = believe(Log(kind="CSV", channels=log))
    assert joint_names(found, ["j1", "j12"]) == ["j1", "j12"]
    # Without a model, or where none is meant, they keep their own.
    assert joint_names(found) == joint_names(found, ["elbow"]) != ["j1", "j12"]
    (said,) = of_other_joints(joint_names(found, ["elbow"]), ["elbow"])
    assert said.startswith("the model has no joint joints_j_1, ") and "but elbow" in said
    assert of_other_joints(["j1"], ["j1", "j2"]) == []


def a_log(**arrays: np.ndarray) -> list[Belief]:
    channels = [Channel(name=name, values=values) for name, values in arrays.items()]
    return believe(Log(kind="CSV", channels=channels))


def test_a_current_without_a_factor_is_told_with_what_to_type() -> None:
    """It was taken for Nm without a word, and Coulomb friction of 0.8 Nm came out as 0.53."""
    signals = {"time_s": TIME, "elbow_pos_rad": np.sin(TIME)}
    for name, unit in (("elbow_current_mA", "mA"), ("elbow_current", "A")):
        (said,) = of_currents(a_log(**signals, **{name: np.cos(TIME)}), ["elbow"])
        assert f"say --as '{name}=elbow.effort*NM_PER_{unit}'" in said
    torque = {"elbow_current_A": np.cos(TIME), "elbow_torque": np.cos(TIME)}
    assert of_currents(a_log(**signals, **torque), ["elbow"]) == []


def test_a_torque_goes_before_a_current_whichever_the_log_has_first(tmp_path: Path) -> None:
    chosen = a_log(
        **{"t": TIME, "q": np.sin(TIME), "i [A]": np.cos(TIME), "M [Nm]": 9.0 * np.cos(TIME)}
    )
    said, *_ = write_session(tmp_path / "s", "log", chosen, joint_names(chosen, ["elbow"]))
    assert "M [Nm] is taken for elbow.effort, and not i [A]" in said
    assert table(tmp_path / "s" / "log.csv")[1][0, 2] == pytest.approx(9.0)


def test_the_only_joint_of_a_log_is_that_of_the_model_and_said() -> None:
    chosen = a_log(**{"t": TIME, "Ellenbogen angle": np.sin(TIME), "Ellenbogen torque": TIME**2})
    assert joint_names(chosen, ["elbow"]) == ["elbow"]
    assert of_only_joint(chosen, ["elbow"]) == [
        "the log's only joint, ellenbogen, is taken for the model's, elbow"
    ]
    assert of_only_joint(chosen, ["r_ellenbogen"])
    assert of_only_joint(chosen, ["ellenbogen"]) == of_only_joint(chosen, ["a", "b"]) == []
    assert of_only_joint(beliefs(), ["elbow"]) == []


def test_what_lacks_a_position_is_told_by_its_channels(tmp_path: Path) -> None:
    chosen = a_log(**{"Zeit": TIME, "Moment": np.cos(TIME), "Kraft X": np.sin(TIME)})
    with pytest.raises(SessionError, match="no position is known among Kraft X, Moment: name its"):
        write_session(tmp_path / "s", "log", chosen, joint_names(chosen))


@pytest.mark.parametrize(
    ("channel", "line", "unit", "factor"),
    [
        # By its name, by its size, and by the size of an angle whose name says nothing.
        ("Winkel [°]", "Winkel [°]=elbow.position", "deg", "0.0174533"),
        ("angle", "angle=elbow.position", "deg", "0.0174533"),
        ("phi", "phi=elbow.position", "deg", "0.0174533"),
        ("speed_deg", "speed_deg=elbow.velocity", "deg", "0.0174533"),
        ("M [mNm]", "M [mNm]=elbow.effort", "mNm", "0.001"),
        ("strom_mA", "strom_mA=elbow.effort", "mA", "NM_PER_mA"),
    ],
)
def test_another_unit_assigned_without_a_factor_is_told_with_what_to_type(
    channel: str, line: str, unit: str, factor: str
) -> None:
    """An angle in degrees was taken for radians without a word."""
    (said,) = of_factors(a_log(t=TIME, **{channel: 40 * np.sin(TIME)}), [line])
    assert said == (
        f"{channel} seems to be in {unit}, and without a factor was taken for SI units: if it is "
        f"in {unit}, say --as '{line}*{factor}'"
    )


def test_a_clock_in_ms_is_told_as_well() -> None:
    (said,) = of_factors(a_log(stamp=1e3 * TIME, q=np.sin(TIME)), ["stamp=time"])
    assert said.endswith("say --as 'stamp=time*0.001'")


@pytest.mark.parametrize(
    ("channel", "line"),
    [
        ("Winkel [°]", "Winkel [°]=elbow.position*0.0174533"),
        ("Winkel [°]", "Winkel [°]=elbow.position*1"),
        ("Winkel [°]", "Winkel [°]=-"),
        ("Winkel [rad]", "Winkel [rad]=elbow.position"),
        ("M [Nm]", "M [Nm]=elbow.effort"),
        ("phi", "phi=elbow.effort"),
    ],
)
def test_a_factor_that_is_said_or_none_that_is_needed_is_no_matter(channel: str, line: str) -> None:
    assert of_factors(a_log(t=TIME, **{channel: 40 * np.sin(TIME)}), [line]) == []


def test_an_effort_and_a_position_whose_names_part_them_are_told_with_what_to_type() -> None:
    """A unit that is none of ours was taken for a part of the joint's name."""
    found = a_log(t=TIME, elbow_pos=np.sin(TIME), **{"elbow torque [% rated]": np.cos(TIME)})
    assert of_parted_joints(found, joint_names(found)) == [
        "elbow_rated has an effort and no position, elbow no effort: if they are one joint, say "
        "--as 'elbow torque [% rated]=elbow.effort*FACTOR_TO_SI'"
    ]
    found = a_log(t=TIME, a_pos=np.sin(TIME), a_torque=np.cos(TIME), b_torque=np.sin(2 * TIME))
    assert of_parted_joints(found, joint_names(found)) == []


def test_efforts_of_five_joints_without_a_position_are_said_at_once() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    arrays = {"time": time, "elbow_pos": np.sin(time)}
    arrays |= {f"motor_{n}_torque": np.cos(n * time) for n in range(1, 6)}
    log = Log(kind="CSV", channels=[Channel(name=n, values=v) for n, v in arrays.items()])
    beliefs = believe(log)
    (said,) = of_parted_joints(beliefs, joint_names(beliefs))
    assert said.startswith("motor_1, motor_2, motor_3")
    assert "have an effort and no position, elbow no effort: if two are one joint" in said


def test_what_a_torque_was_made_of_is_no_joint_s_name(tmp_path: Path) -> None:
    """A stranger's torque of the ankle was that of a joint ankle_from_current, with the motor's
    angle for its position: a command without a name hid all others.
    """
    found = a_log(
        t=TIME,
        motor_angle=50 * np.cos(TIME),
        ankle_angle=np.sin(TIME),
        ankle_torque_from_current=np.cos(2 * TIME),
        commanded_position=50 * np.cos(TIME) + 0.1,
    )
    write_session(tmp_path / "s", "log", found, joint_names(found))
    names, numbers = table(tmp_path / "s" / "log.csv")
    assert {"motor.position", "ankle.position", "ankle.effort"} <= set(names)
    at = names.index("ankle.effort")
    assert numbers[:, at] == pytest.approx(np.cos(2 * TIME), abs=1e-6)


def test_signals_of_one_kind_without_a_unit_are_told_of_at_once(tmp_path: Path) -> None:
    """There was a line for each of the eighteen signals of a robot."""
    signals = {"a_pos": np.sin(TIME), "b_pos": np.cos(TIME), "a_torque": TIME**2, "t": TIME}
    chosen = a_log(**signals)
    said = write_session(tmp_path / "s", "log", chosen, joint_names(chosen))
    assert said[:2] == [
        "a_pos, b_pos are taken for position in rad; if one is not, say --as "
        "'a_pos=a.position*FACTOR_TO_SI'",
        "a_torque is taken for a.effort in Nm or N; if it is not, say --as "
        "'a_torque=a.effort*FACTOR_TO_SI'",
    ]


def six(positions: int, efforts: int) -> list[Belief]:
    """Return a log of six joints whose positions and efforts count from one number each."""
    arrays = {"t": TIME}
    arrays |= {f"q{n + positions}": np.sin(TIME + n) for n in range(6)}
    arrays |= {f"tau{n + efforts}": np.cos(3 * TIME + n) for n in range(6)}
    return believe(Log(kind="CSV", channels=[Channel(name=n, values=v) for n, v in arrays.items()]))


SIX = [f"joint{n}" for n in range(1, 7)]


@pytest.mark.parametrize(("positions", "efforts"), [(0, 1), (1, 0), (0, 0), (1, 1)])
def test_columns_that_count_from_0_and_from_1_are_of_the_same_joints(
    positions: int, efforts: int
) -> None:
    found, joints = assigned(six(positions, efforts), [], SIX)
    assert joints == SIX
    assert [b.joint for b in found] == [None, *range(6), *range(6)]


def test_fewer_efforts_than_positions_keep_their_numbers() -> None:
    log = Log(kind="CSV", channels=[b.channel for b in six(0, 1) if b.channel.name != "tau6"])
    alone = {b.channel.name: b.joint for b in believe(log)}
    assert alone["tau1"] == alone["q1"] == 1


def test_what_is_said_of_some_channels_moves_no_others(tmp_path: Path) -> None:
    lines = [f"tau{n}=joint{n}.effort" for n in range(1, 7)]
    found, joints = assigned(six(0, 1), lines, SIX)
    assert [b.joint for b in found] == [None, *range(6), *range(6)] and joints == SIX
    # An effort that is said to be of another joint takes no position along.
    found, joints = assigned(six(1, 1), ["tau2=joint1.effort"], SIX)
    named = {b.channel.name: joints[b.joint] for b in found if b.joint is not None}
    assert named["q2"] == "joint2" and named["tau3"] == "joint3"
    assert named["tau2"] == named["q1"] == "joint1"
    said = write_session(tmp_path / "s", "log", found, joints)
    assert "tau2 is taken for joint1.effort, and not tau1: for another say --as " in said[0]


def test_a_new_name_is_a_joint_s_only_if_no_other_channel_says_so() -> None:
    found, joints = assigned(six(1, 1), ["tau1=elbow.effort"])
    assert joints[0] == "elbow" and found[1].joint == 0
    found, joints = assigned(six(1, 1), ["tau1=elbow.effort", "q2=elbow.position"])
    named = {b.channel.name: joints[b.joint] for b in found if b.joint is not None}
    assert (named["tau1"], named["q2"]) == ("elbow", "elbow")
    assert (named["q1"], named["tau2"]) == ("joint_1", "joint_2")


def test_a_number_of_a_log_is_that_of_the_model_s_joint() -> None:
    channels = [b.channel for b in six(1, 1) if b.channel.name[-1] not in "16"]
    found = believe(Log(kind="CSV", channels=channels))
    assert joint_names(found, SIX) == ["joint2", "joint3", "joint4", "joint5"]
    assert joint_names(six(0, 0), [*SIX, "joint7"]) == SIX
    assert joint_names(six(1, 1), ["a", "b", "c", "d", "e", "f"]) == ["a", "b", "c", "d", "e", "f"]


def test_plural_words_are_those_of_quantities() -> None:
    arrays = {"t": TIME}
    arrays |= {f"positions[{n}]": np.sin(TIME + n) for n in range(3)}
    arrays |= {f"torques[{n}]": np.cos(3 * TIME + n) for n in range(3)}
    channels = [Channel(name=name, values=values) for name, values in arrays.items()]
    found = believe(Log(kind="CSV", channels=channels))
    assert [b.quantity for b in found[1:]] == ["position"] * 3 + ["effort"] * 3
    assert [b.joint for b in found[1:]] == [0, 1, 2, 0, 1, 2]
    (said,) = of_order(found, ["shoulder", "elbow", "wrist"])
    assert "in the model's order, shoulder, elbow, wrist: " in said
    assert of_order(found, ["j0", "j1", "j2"]) == of_order(found, ["shoulder"]) == []


def test_a_log_of_words_alone_is_told_so(tmp_path: Path) -> None:
    clock = believe(Log(kind="CSV", channels=[Channel(name="t", values=TIME)]))
    with pytest.raises(SessionError, match="no column beside the clock holds numbers"):
        write_session(tmp_path / "s", "log", clock, [])


def test_joints_of_a_urdf_are_told_from_base_to_tip(tmp_path: Path) -> None:
    """Some programs write them from the tip; a log's first joint became the gripper."""

    def joint(name: str, parent: str, child: str) -> str:
        sides = f'<parent link="{parent}"/><child link="{child}"/>'
        return f'<joint name="{name}" type="revolute">{sides}</joint>'

    chain = [joint("grip", "c", "d"), joint("elbow", "b", "c"), joint("pan", "a", "b")]
    arms = [joint("left", "a", "l"), joint("right", "a", "r"), joint("hand", "l", "h")]
    for joints, expected in (
        (chain, ["pan", "elbow", "grip"]),
        (arms, ["left", "right", "hand"]),
        ([joint("one", "a", "b"), joint("two", "b", "a")], ["one", "two"]),
    ):
        (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{"".join(joints)}</robot>')
        assert joints_in(tmp_path / "arm.urdf") == expected


def test_what_has_the_name_of_the_model_s_joint_is_its_position() -> None:
    """A pendulum's alpha was unknown, and its theta no joint of the model."""
    arrays = {"t": TIME, "alpha": np.sin(3 * TIME), "target_alpha": TIME, "theta": np.cos(TIME)}
    arrays |= {"alpha_tau": np.cos(2 * TIME)}
    channels = [Channel(name=name, values=values) for name, values in arrays.items()]
    found = believe(Log(kind="CSV", channels=channels), known=["theta", "alpha"])
    _, joints = assigned(found, [], ["theta", "alpha"])
    named = {b.channel.name: joints[b.joint] for b in found if b.joint is not None}
    assert named == {"alpha": "alpha", "theta": "theta", "alpha_tau": "alpha"}
    assert [b.quantity for b in found if not b.wanted] == [
        *("time", "position", "position", "effort")
    ]
