"""What is believed of a log: its clock, its units, which channel is which signal of a joint."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.clock import clock_of
from analysis.closeloop.logs.inspection import believe, of_hertz, of_rates, of_turns
from analysis.closeloop.logs.joints import joint_names
from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.logs.reading import read_log
from analysis.closeloop.logs.variants import of_followed, of_variants

DEG = 180 / np.pi


def motion(joints: int = 2, rate: float = 200.0, seconds: float = 8.0) -> dict[str, np.ndarray]:
    """Return a time and the positions and velocities, (n, joints), of a smooth motion, SI units."""
    time = np.arange(0.0, seconds, 1 / rate)
    phase = np.outer(time, 1.0 + 0.7 * np.arange(joints)) + np.arange(joints)
    position = np.sin(phase) + 0.3 * np.sin(2.3 * phase)
    velocity = (1.0 + 0.7 * np.arange(joints)) * (np.cos(phase) + 0.69 * np.cos(2.3 * phase))
    return {"time": time, "position": position, "velocity": velocity}


def believed(**arrays: np.ndarray) -> dict[str, Belief]:
    log = Log(kind="CSV", channels=[Channel(name=n, values=v) for n, v in arrays.items()])
    return {belief.channel.name: belief for belief in believe(log)}


def headerless(path: Path, *, scale: float = 1.0, moving: int = 2) -> Path:
    """Write clock, positions, velocities and efforts of two joints, of which some move."""
    m = motion()
    rest = np.random.default_rng(0).normal(0.0, 1e-4, m["position"].shape)
    position = np.where(np.arange(2) < moving, m["position"], rest)
    velocity = np.where(np.arange(2) < moving, m["velocity"], rest[::-1])
    table = np.column_stack([m["time"], scale * position, velocity, 2 * position + velocity])
    np.savetxt(path, table, delimiter=",", fmt="%.6f")
    return path


def test_a_file_without_a_header_keeps_its_first_sample_and_shows_its_joints(
    tmp_path: Path,
) -> None:
    log = read_log(headerless(tmp_path / "log.csv"))
    assert len(log.channels[0].values) == len(motion()["time"])
    assert "no header" in log.remarks[0]
    found = [(b.quantity, b.joint, b.unit) for b in believe(log)]
    assert found == [
        ("time", None, "s"),
        ("position", 0, "rad?"),
        ("position", 1, "rad?"),
        ("velocity", 0, "rad/s?"),
        ("velocity", 1, "rad/s?"),
        ("effort", 0, "?"),
        ("effort", 1, "?"),
    ]


def test_joints_at_rest_are_read_off_the_layout(tmp_path: Path) -> None:
    beliefs = believe(read_log(headerless(tmp_path / "log.csv", moving=1)))
    assert [b.quantity for b in beliefs[1:]] == [
        *("position", "position", "velocity", "velocity", "effort", "effort")
    ]
    assert "should" in beliefs[2].why


def test_degrees_with_velocities_in_rad_are_told_by_the_factor(tmp_path: Path) -> None:
    beliefs = believe(read_log(headerless(tmp_path / "log.csv", scale=DEG)))
    assert beliefs[1].unit == "deg" and beliefs[1].scale == pytest.approx(1 / DEG)
    assert beliefs[3].unit == "rad/s" and beliefs[3].scale == 1.0


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_clock_in_any_unit_is_found(scale: float, unit: str) -> None:
    m = motion(joints=1)
    found = believed(stamp=scale * (m["time"] + 1e3), angle=m["position"][:, 0])
    assert (found["stamp"].quantity, found["stamp"].unit) == ("time", unit)
    time = found["angle"].channel.time
    assert time is not None and clock_of(time).rate == pytest.approx(200.0)


def test_what_was_wanted_is_not_what_was_measured() -> None:
    m = motion(joints=1)
    found = believed(t=m["time"], q_ref=m["position"][:, 0], q=m["position"][:, 0] + 0.01)
    assert found["q_ref"].wanted and not found["q"].wanted
    assert found["q"].joint == 0


def test_units_in_names_are_taken_at_their_word() -> None:
    m = motion(joints=1)
    found = believed(
        t_s=m["time"], angle_deg=DEG * m["position"][:, 0], torque_Nm=m["velocity"][:, 0]
    )
    assert found["angle_deg"].unit == "deg" and found["torque_Nm"].unit == "Nm"


def test_large_angles_without_a_unit_are_degrees() -> None:
    m = motion(joints=1)
    found = believed(time=m["time"], angle=90.0 * m["position"][:, 0])
    assert found["angle"].unit == "deg?" and found["angle"].scale == pytest.approx(1 / DEG)


def test_a_channel_that_never_changes_is_said_to_be_constant() -> None:
    m = motion(joints=1)
    found = believed(time=m["time"], angle=m["position"][:, 0], status=np.ones(len(m["time"])))
    assert found["status"].quantity == "constant"


def numbered(quantities: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return channels of three joints as a Kinova's log names them; the first is held."""
    m = motion(joints=2)
    signals = {"Position": m["position"], "Velocity": m["velocity"], "TorqueCur": m["position"]}
    channels = {"Time": m["time"], "Position1": np.full(len(m["time"]), -4e-6)}
    for quantity in quantities:
        for joint in (0, 1):
            channels[f"{quantity}{joint + 2}"] = signals[quantity][:, joint]
    return channels


def test_numbers_in_names_are_those_of_joints_and_a_held_joint_counts() -> None:
    found = believed(**numbered(("TorqueCur", "Position", "Velocity")))
    joints = {name: belief.joint for name, belief in found.items() if name != "Time"}
    assert joints == {
        "Position1": 0,
        **{f"{name}{n}": n - 1 for name in ("Position", "Velocity", "TorqueCur") for n in (2, 3)},
    }
    assert found["Position1"].quantity == "position" and found["TorqueCur2"].quantity == "effort"
    assert joint_names([*found.values()], ["base", "elbow", "wrist"]) == ["base", "elbow", "wrist"]


def test_words_that_run_together_are_told_apart() -> None:
    m = motion(joints=1)
    wanted = m["position"][:, 0] + 0.01
    found = believed(Time=m["time"], Position1=m["position"][:, 0], PositionCmptd1=wanted)
    assert found["PositionCmptd1"].wanted and not found["Position1"].wanted


@pytest.mark.parametrize("before", ["j", "q", "joint"])
def test_a_word_that_a_joint_s_letter_runs_together_with_is_read(before: str) -> None:
    """A dog's log with `jpos0`, `jvel0`, ... at 200 Hz, without a clock, was all unknown."""
    m = motion()
    names = {"pos": m["position"], "vel": m["velocity"]}
    found = believed(
        **{f"{before}{name}{n}": v[:, n] for name, v in names.items() for n in (0, 1)},
        **{f"{before}pos0_des": m["position"][:, 0] + 0.01},
    )
    assert [(b.quantity, b.joint, b.wanted) for b in found.values()] == [
        *(("position", 0, False), ("position", 1, False)),
        *(("velocity", 0, False), ("velocity", 1, False)),
        ("position", 0, True),
    ]
    time = found[f"{before}vel1"].channel.time
    assert time is not None and clock_of(time).rate == pytest.approx(200.0)


@pytest.mark.parametrize("name", ["level", "compos", "xpos"])
def test_a_word_that_only_ends_as_a_quantity_does_is_none(name: str) -> None:
    assert believed(**{name: motion()["position"][:, 0]})[name].quantity == "unknown"


def test_noise_is_nobodys_derivative() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 5.0, 0.01)
    found = believed(**{"time": time, **{f"x{n}": rng.normal(size=500) for n in range(12)}})
    assert {b.quantity for name, b in found.items() if name != "time"} == {"unknown"}


def test_gaps_jitter_and_repeated_stamps_are_counted() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    time = np.concatenate([time[:50], time[80:], time[-1:]])
    clock = clock_of(time)
    assert (clock.gaps, clock.repeated) == (1, 1)
    assert clock.longest_gap == pytest.approx(0.31) and clock.rate == pytest.approx(100.0)


def test_a_velocity_belongs_to_the_position_that_it_is_the_derivative_of() -> None:
    m = motion()
    q, v = m["position"], m["velocity"]
    found = believed(a=m["time"], b=q[:, 0], c=q[:, 1], d=v[:, 1], e=v[:, 0])
    assert [found[name].joint for name in "bcde"] == [0, 1, 1, 0]


def test_names_of_joints_go_before_the_order_of_columns() -> None:
    m = motion()
    found = believed(
        time=m["time"],
        wrist_pos=m["position"][:, 0],
        elbow_pos=m["position"][:, 1],
        elbow_torque=m["velocity"][:, 1],
        wrist_torque=m["velocity"][:, 0],
    )
    assert [b.joint for b in found.values()] == [None, 0, 1, 1, 0]
    assert found["wrist_torque"].stem == "wrist"


@pytest.mark.parametrize("shape", ["rich", "one sine"])
def test_an_acceleration_is_no_velocity_and_what_stands_behind_it_is_the_effort(shape: str) -> None:
    t = np.arange(0.0, 8.0, 0.005)
    w = np.array([1.0, 2.3]) if shape == "rich" else np.array([1.0])
    q, v, a = (
        sum(f(x * t) * x**k for x in w)
        for k, f in enumerate((np.sin, np.cos, lambda x: -np.sin(x)))
    )
    found = believed(a=t, b=q, c=v, d=a, e=0.3 * q + np.sign(v))
    assert [b.quantity for b in found.values()] == [
        *("time", "position", "velocity", "acceleration", "effort")
    ]


def test_a_counter_of_samples_is_no_clock() -> None:
    m = motion(joints=1)
    count = np.arange(len(m["time"]), dtype=float)
    found = believed(a=count, b=m["time"], c=m["position"][:, 0])
    assert found["a"].quantity == "unknown" and "counts" in found["a"].why
    assert found["b"].quantity == "time" and found["b"].unit == "s"


def test_missing_samples_do_not_hide_a_derivative() -> None:
    m = motion(joints=1)
    position = m["position"][:, 0].copy()
    position[::9] = np.nan
    found = believed(a=m["time"], b=position, c=m["velocity"][:, 0])
    assert found["c"].quantity == "velocity" and found["c"].source == 1


def test_a_name_that_the_numbers_contradict_is_said() -> None:
    m = motion(joints=1)
    found = believed(time=m["time"], elbow_vel=m["position"][:, 0], elbow_pos=m["velocity"][:, 0])
    assert found["elbow_pos"].quantity == "position"
    assert "but it is the derivative of elbow_vel" in found["elbow_pos"].why


def test_what_has_another_name_is_no_joint() -> None:
    m = motion(joints=1)
    found = believed(
        time=m["time"], temperature=20 + m["position"][:, 0], warming=m["velocity"][:, 0]
    )
    assert {found["temperature"].quantity, found["warming"].quantity} == {"unknown"}


@pytest.mark.parametrize("suffix", ["", ".txt"])
def test_what_a_controller_has_left_to_do_is_no_measured_signal(suffix: str) -> None:
    m = motion()
    arrays = {"time": m["time"]}
    for n in (0, 1):
        q, v = m["position"][:, n], m["velocity"][:, n]
        arrays |= {f"error_pos_{n + 1}": -q + 0.1, f"error_vel_{n + 1}": -v}
        arrays |= {f"posa{n + 1}": q, f"vela{n + 1}": v, f"posd{n + 1}": q + 0.1}
        arrays |= {f"trq{n + 1}": np.sin(3 * q) + v}
    found = believed(**{f"{name}{suffix}": values for name, values in arrays.items()})
    seen = {(b.quantity, b.wanted, b.joint): name for name, b in found.items()}
    for n in (0, 1):
        for quantity, name in (("position", "posa"), ("velocity", "vela"), ("effort", "trq")):
            assert seen[quantity, False, n] == f"{name}{n + 1}{suffix}"
        assert seen["position", True, n] == f"posd{n + 1}{suffix}"
    errors = [b for name, b in found.items() if "error" in name]
    assert {(b.quantity, b.joint) for b in errors} == {("unknown", None)}
    assert joint_names([*found.values()]) == ["joint_1", "joint_2"]


@pytest.mark.parametrize("name", ["tracking_1", "position_deviation", "elbow.pos_err"])
def test_a_deviation_by_any_word_is_no_position(name: str) -> None:
    m = motion(joints=1)
    channel = name if "pos" in name else f"pos_{name}"
    found = believed(time=m["time"], elbow_pos=m["position"][:, 0], **{channel: m["time"] ** 2})
    assert found[channel].joint is None and found["elbow_pos"].joint == 0


def test_a_topic_that_tracks_holds_measured_positions() -> None:
    m = motion(joints=1)
    name = "/tracking_controller/state/positions[0]"
    assert believed(time=m["time"], **{name: m["position"][:, 0]})[name].quantity == "position"


def test_a_pose_and_a_wrench_are_a_tools_and_numbered_joints_are_positions() -> None:
    m = motion(joints=3)
    q, v = m["position"], m["velocity"]
    arrays = {"time": m["time"]}
    for n, axis in enumerate("xyz"):
        arrays |= {f"current_pos_{axis}": q[:, n] / 9, f"goal_pos_{axis}": q[:, n] / 9.1}
        arrays |= {f"current_orientation_{axis}": np.sin(q[:, n])}
        arrays |= {f"force_{axis}": v[:, n] ** 2, f"torque_{axis}": np.cos(q[:, n])}
    arrays |= {f"goal_orientation_{axis}": np.cos(m["time"] + n) for n, axis in enumerate("wxyz")}
    joints = {f"joint_{n + 1}": q[:, n] for n in range(3)} | {"joint_4": np.ones(len(q))}
    found = believed(**arrays, **joints)
    assert {name: b.joint for name, b in found.items() if b.joint is not None} == {
        name: n for n, name in enumerate(joints)
    }
    assert {found[name].quantity for name in joints} == {"position"}
    assert joint_names([*found.values()]) == [*joints]


def test_a_gantry_has_joints_called_as_axes_are() -> None:
    m = motion()
    q, v = m["position"], m["velocity"]
    arrays = {f"pos_{axis}": q[:, n] for n, axis in enumerate("xy")}
    arrays |= {f"force_{axis}": np.sin(3 * v[:, n]) for n, axis in enumerate("xy")}
    found = believed(time=m["time"], **arrays)
    assert [b.joint for b in found.values()] == [None, 0, 1, 0, 1]


def test_current_before_a_motion_is_of_now_and_else_a_motors() -> None:
    m = motion(joints=1)
    q, v = m["position"][:, 0], m["velocity"][:, 0]
    now = believed(time=m["time"], current_joint_position_1=q, current_joint_velocity_1=v)
    assert [b.quantity for b in now.values()] == ["time", "position", "velocity"]
    assert [b.joint for b in now.values()] == [None, 0, 0]
    motors = believed(time=m["time"], position_joint_1=q, current_joint_1=np.sin(3 * v))
    assert [b.quantity for b in motors.values()] == ["time", "position", "current"]
    alone = believed(time=m["time"], current_joint_1=q, goal_joint_1=q + 0.1)
    assert alone["current_joint_1"].quantity == "position"


def test_a_numbered_joint_beside_a_position_is_left_unknown() -> None:
    m = motion()
    found = believed(time=m["time"], elbow_pos=m["position"][:, 0], joint_1=m["position"][:, 1])
    assert found["joint_1"].quantity == "unknown"


def test_a_cartesian_controller_has_joints() -> None:
    m = motion(joints=1)
    name = "/cartesian_controller/state.position[0]"
    assert believed(time=m["time"], **{name: m["position"][:, 0]})[name].quantity == "position"


def test_of_a_motor_that_turns_on_and_on_it_is_asked_which_unit_it_is_in() -> None:
    m = motion(joints=1)
    turning = 500.0 * (m["time"] + 0.1 * np.sin(m["time"]))
    (said,) = of_turns([*believed(time=m["time"], q=turning).values()])
    assert said.startswith("q goes through") and "in degrees (11.2 turns)" in said
    assert "in radians (644)" in said and "which is it?" in said
    assert of_turns([*believed(time=m["time"], q=60.0 * m["position"][:, 0]).values()]) == []


def test_a_velocity_in_hertz_is_of_its_joint_in_turns_a_second() -> None:
    m = motion(joints=1)
    q, v = m["position"][:, 0], m["velocity"][:, 0]
    turns = {"c1 position [rev]": q / (2 * np.pi), "c1 vel [Hz]": v / (2 * np.pi)}
    found = believed(time=m["time"], **turns, **{"c1 torque [Nm]": np.sin(3 * v)})
    velocity = found["c1 vel [Hz]"]
    assert (velocity.quantity, velocity.joint, velocity.stem) == ("velocity", 0, "c_1")
    assert velocity.scale == pytest.approx(2 * np.pi)
    assert "by 2 pi" in of_hertz([*found.values()])[0]
    assert believed(time=m["time"], **{"torque rate [Hz]": q})["torque rate [Hz]"].joint is None


def test_units_of_no_signal_are_no_part_of_a_joints_name() -> None:
    m = motion(joints=1)
    counts = {"elbow pos [counts]": m["position"][:, 0], "q (left)": m["velocity"][:, 0]}
    found = believed(time=m["time"], **counts)
    assert [b.stem for b in found.values()] == ["", "elbow", "left"]


@pytest.mark.parametrize("name", ["observed torque constant [Nm/A]", "torque_gain", "v (rad/s/V)"])
def test_a_constant_is_no_signal_of_a_joint(name: str) -> None:
    m = motion(joints=1)
    found = believed(time=m["time"], elbow_pos=m["position"][:, 0], **{name: m["time"] ** 2})
    assert found[name].quantity == "unknown" and "a constant" in found[name].why


def test_a_constant_torque_is_a_torque() -> None:
    m = motion(joints=1)
    found = believed(time=m["time"], constant_torque=m["position"][:, 0])
    assert found["constant_torque"].joint == 0


def clockless(path: Path, *, twist: float = 1.0) -> Path:
    """Write positions, velocities and efforts of two joints at 200 Hz, without a clock."""
    m = motion()
    velocity = m["velocity"] * np.array([1.0, twist])
    table = np.column_stack([m["position"], velocity, 2 * m["position"] + m["velocity"]])
    np.savetxt(path, table, delimiter=",", fmt="%.6f")
    return path


def test_velocities_tell_the_rate_of_a_log_without_a_clock(tmp_path: Path) -> None:
    log = read_log(clockless(tmp_path / "log.csv"))
    beliefs = believe(log)
    assert [b.quantity for b in beliefs] == [
        *("position", "position", "velocity", "velocity", "effort", "effort")
    ]
    for belief in beliefs:
        assert belief.channel.time is not None
        assert clock_of(belief.channel.time).rate == pytest.approx(200.0)
    (said,) = of_rates(log, beliefs)
    assert "say 200 Hz" in said and "--rate" in said


def test_pairs_that_say_other_rates_tell_none(tmp_path: Path) -> None:
    log = read_log(clockless(tmp_path / "log.csv", twist=1.5))
    beliefs = believe(log)
    assert (
        all(b.channel.time is None for b in beliefs) and "give --rate" in of_rates(log, beliefs)[0]
    )


def test_a_log_without_a_clock_has_the_rate_that_its_user_says(tmp_path: Path) -> None:
    log = read_log(clockless(tmp_path / "log.csv", twist=1.5))
    time = believe(log, rate_hz=125.0)[0].channel.time
    assert time is not None and clock_of(time).rate == pytest.approx(125.0)


def test_what_rises_and_stays_by_turns_and_has_no_name_of_a_clock_is_none() -> None:
    """A real arm's wanted position took a third of its samples, though its rate was given."""
    wanted = np.sort(np.concatenate([np.arange(800.0), np.arange(0.0, 800.0, 4.0)])) / 100.0
    log = log_of("CSV", {"x": wanted, "q1": np.sin(wanted), "tau1": np.cos(wanted)}.items())
    beliefs = believe(log, rate_hz=100.0)
    assert [b.quantity for b in beliefs] == ["unknown", "position", "effort"]
    assert beliefs[0].channel.time is not None and len(beliefs[0].channel.time) == len(wanted)
    assert clock_of(beliefs[0].channel.time).repeated == 0


def test_a_log_with_a_clock_keeps_it(tmp_path: Path) -> None:
    log = read_log(headerless(tmp_path / "log.csv"))
    beliefs = believe(log, rate_hz=50.0)
    assert beliefs[0].quantity == "time" and of_rates(log, beliefs) == []


def test_a_stamp_in_two_columns_is_one_clock() -> None:
    """As a ROS header is written out."""
    m = motion(joints=1)
    parts = {
        "header.stamp.sec": 1e9 + np.floor(m["time"]),
        "header.stamp.nanosec": np.round(1e9 * (m["time"] % 1.0)),
    }
    found = believed(**parts, **{"elbow.position": m["position"][:, 0]})
    assert [b.quantity for b in found.values()] == ["time", "unknown", "position"]
    time = found["elbow.position"].channel.time
    assert time is not None and time - 1e9 == pytest.approx(m["time"], abs=1e-6)


def test_one_glitch_makes_no_degrees() -> None:
    m = motion(joints=2)
    elbow, wrist = m["position"].T.copy()
    elbow[700] = 1e6
    found = believed(**{"time": m["time"], "elbow.position": elbow, "wrist.position": wrist})
    assert found["elbow.position"].unit == found["wrist.position"].unit == "rad?"


def test_more_signals_than_any_robot_has_are_not_compared_each_with_each() -> None:
    signals = {f"q{n}.position": np.sin(0.01 * np.arange(60) + n) for n in range(1, 3000)}
    found = believed(time=0.01 * np.arange(60), **signals)
    assert {b.quantity for b in found.values()} == {"time", "position"}


def test_a_unit_says_what_a_channel_is_in_any_language() -> None:
    """None of these words is known; what both signals are called after is the joint."""
    m = motion()
    found = believed(
        **{
            "Zeit [s]": m["time"],
            "Gelenkwinkel Schulter [°]": DEG * m["position"][:, 0],
            "Gelenkwinkel Ellenbogen [°]": DEG * m["position"][:, 1],
            "Drehmoment Ellenbogen [Nm]": m["velocity"][:, 1],
            "Drehmoment Schulter [Nm]": m["velocity"][:, 0],
            "Motorstrom [mA]": m["velocity"][:, 0],
            "Hand X [mm]": m["position"][:, 0],
        }
    )
    assert [(b.quantity, b.unit, b.joint) for b in found.values()] == [
        ("time", "s", None),
        ("position", "deg", 0),
        ("position", "deg", 1),
        ("effort", "Nm", 1),
        ("effort", "Nm", 0),
        ("current", "mA", 0),
        ("unknown", "mm", None),
    ]
    assert joint_names([*found.values()]) == ["schulter", "ellenbogen"]


def test_the_unit_of_a_clock_goes_before_what_its_steps_could_be() -> None:
    """At 10 kHz a step of 0.1 could be one of 10 Hz in s."""
    time = np.arange(0.0, 400.0, 0.1)
    assert believed(**{"Zeit [ms]": time, "q": np.sin(time)})["Zeit [ms]"].unit == "ms"


def test_a_unit_goes_before_a_word_and_volts_are_no_velocity() -> None:
    """As in the EMPS: what is controlled by a voltage writes u_V."""
    m = motion()
    q, v = m["position"], m["velocity"]
    volts = np.sin(3 * m["time"]) * q[:, 1]
    found = believed(**{"t_s": m["time"], "q_m": q[:, 0], "u_V": volts, "torque [A]": v[:, 1]})
    assert (found["u_V"].quantity, found["u_V"].unit) == ("unknown", "V")
    assert (found["torque [A]"].quantity, found["torque [A]"].unit) == ("current", "A")
    # A single letter may be the name of a joint or a part.
    found = believed(time=m["time"], q_A=q[:, 0], tau_A=v[:, 1], q_B=q[:, 1], tau_m=v[:, 0])
    assert [b.quantity for b in found.values()] == [
        *("time", "position", "effort", "position", "effort")
    ]


def test_a_franka_wants_what_it_calls_q_d_and_its_hand_is_no_joint() -> None:
    m = motion()
    q, v = m["position"], m["velocity"]
    arrays = {"time": m["time"]}
    for n in (0, 1):
        arrays |= {f"q[{n}]": q[:, n], f"q_d[{n}]": q[:, n] + 0.01, f"tau_J[{n}]": v[:, 1 - n]}
    found = believed(**arrays, **{"O_T_EE[0]": q[:, 0] + q[:, 1]})
    assert [name for name, b in found.items() if b.wanted] == ["q_d[0]", "q_d[1]"]
    assert found["tau_J[1]"].joint == found["q[1]"].joint == 1
    assert found["O_T_EE[0]"].quantity == "unknown"
    assert believed(time=m["time"], tool_joint_pos=q[:, 0])["tool_joint_pos"].joint == 0
    # Of four joints a to d none is what another should be.
    letters = {f"q_{letter}": q[:, 0] + n for n, letter in enumerate("abcd")}
    assert not any(b.wanted for b in believed(time=m["time"], **letters).values())


def forms(raw: str = "raw") -> dict[str, np.ndarray]:
    """Return channels of two joints whose positions a program wrote raw and filtered."""
    m, rng = motion(joints=2), np.random.default_rng(3)
    channels = {"time": m["time"]}
    for n in range(2):
        q = m["position"][:, n]
        channels |= {f"q_filt[{n}]": q, f"q_{raw}[{n}]": q + 1e-3 * rng.standard_normal(len(q))}
        channels |= {f"tau_filt[{n}]": np.cos(q), f"t_filt[{n}]": np.sin(3 * q)}
    return channels


def test_forms_of_one_signal_are_no_further_joints() -> None:
    found = believed(**forms())
    assert [(b.quantity, b.joint) for n, b in found.items() if n.startswith("q_raw")] == [
        *(("position", 0), ("position", 1))
    ]
    assert [found[f"tau_filt[{n}]"].joint for n in range(2)] == [0, 1]
    assert found["q_filt[1]"].quantity == "unknown"
    assert of_variants([*found.values()]) == [
        "left out: q_filt (other forms of what is taken: q_filt[1] is another form of q_raw[1])"
    ]


def test_names_of_joints_that_are_no_forms_stay() -> None:
    found = believed(**forms(raw="left"))
    assert found["q_left[0]"].quantity == found["q_filt[0]"].quantity == "position"
    assert of_variants([*found.values()]) == []
    other = {name: values for name, values in forms().items() if not name.startswith("q_raw")}
    other |= {f"q_raw[{n}]": np.cos(7 * other["time"] + n) for n in range(2)}
    assert of_variants([*believed(**other).values()]) == []


def test_what_goes_back_again_and_again_is_no_time() -> None:
    """`t` is a torque to some: six joints' of them were six clocks."""
    found = believed(**forms())
    assert found["time"].quantity == "time"
    assert found["t_filt[0]"].quantity == "unknown" and "no clock" in found["t_filt[0]"].why


def kinova(dead: float, size: float) -> dict[str, Belief]:
    """Return what is believed of two sets of efforts, of which one's last is so large."""
    m = motion(joints=3)
    channels = {"Time": m["time"]}
    for n in range(3):
        q = m["position"][:, n]
        channels |= {f"Position{n + 1}": q, f"TorqueCur{n + 1}": np.cos(3 * q)}
        channels |= {f"Torque{n + 1}": size * (dead if n == 2 else 0.3) * np.cos(3 * q)}
    order = sorted(channels, key=lambda name: name.startswith("TorqueCur"))
    return believed(**{name: channels[name] for name in order})


def test_of_two_sets_of_efforts_the_one_that_feels_every_joint_is_taken() -> None:
    found = kinova(dead=1e-3, size=1.0)
    assert [found[f"TorqueCur{n}"].joint for n in (1, 2, 3)] == [0, 1, 2]
    assert {found[f"Torque{n}"].quantity for n in (1, 2, 3)} == {"unknown"}
    (said,) = of_variants([*found.values()])
    assert "Torque3 feels nothing where Position3 moves, beside TorqueCur3" in said


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_two_sets_in_other_units_are_left_alone(size: float) -> None:
    found = kinova(dead=0.1, size=size)
    assert found["Torque1"].quantity == found["TorqueCur1"].quantity == "effort"


def test_a_position_without_a_name_that_goes_as_another_does_is_said() -> None:
    """A UR5's log without a header gave a second joint to what was wanted of the first."""
    m = motion()
    q, v = m["position"], m["velocity"]
    columns = [m["time"], q[:, 0], v[:, 0], q[:, 1], v[:, 1], q[:, 0] + 0.01 * v[:, 0], v[:, 0]]
    found = believed(**{f"column {n}": values for n, values in enumerate(columns, 1)})
    (said,) = of_followed([*found.values()])
    assert said.startswith("column 6 goes as column 2 does")
