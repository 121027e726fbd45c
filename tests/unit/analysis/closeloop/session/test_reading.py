"""Every bad input gets one error with file, column and line, and leaves nothing behind."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.judgement.events import find_events
from analysis.closeloop.load import load_session
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.plausibility import check_saturated, works
from analysis.closeloop.session.runs import saturated_line
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.small import HEADER, Folder
from tests.testbed.sessions.synthetic import mjcf


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


def refusal(folder: Folder) -> SessionError:
    with pytest.raises(SessionError) as caught:
        load_session(folder.write())
    return caught.value


def test_a_clean_session_is_read_with_its_signals(folder: Folder) -> None:
    recording = load_session(folder.write())
    session = recording.session
    assert session.trials[0].group == "a.csv" and session.trials[0].role == "fit"
    elbow = recording.device.joints.index("elbow")
    inside = slice(100, -100)
    assert recording.velocity[inside, elbow] == pytest.approx(
        np.interp(recording.time[inside], folder.table[:, 0], folder.table[:, 3]), abs=0.02
    )
    assert recording.joints == (elbow,)


def test_a_missing_column_is_named(folder: Folder) -> None:
    folder.header = HEADER.replace("shoulder.position", "temperature")
    error = refusal(folder)
    assert (error.file, error.column, error.line) == ("a.csv", "shoulder.position", 1)


@pytest.mark.parametrize("missing", ["time", "elbow.effort"])
def test_time_and_an_effort_must_be_there(folder: Folder, missing: str) -> None:
    folder.header = HEADER.replace(missing, "other")
    assert refusal(folder).column == missing


@pytest.mark.parametrize("cell", ["nan", "inf", "1,2", "abc"])
def test_a_cell_that_is_no_number_is_found_by_line(folder: Folder, cell: str) -> None:
    def spoil(text: str) -> str:
        lines = text.split("\n")
        cells = lines[41].split(",")
        cells[4] = cell
        lines[41] = ",".join(cells)
        return "\n".join(lines)

    folder.edit_text = spoil
    error = refusal(folder)
    assert error.line == 42 and error.file == "a.csv"
    assert error.column == (None if "," in cell else "elbow.effort")


def test_a_blank_line_does_not_shift_the_count(folder: Folder) -> None:
    def spoil(text: str) -> str:
        lines = text.split("\n")
        lines.insert(30, "")
        return "\n".join(lines)

    folder.edit_text = spoil
    assert refusal(folder).line == 31


def test_time_that_does_not_increase_is_found(folder: Folder) -> None:
    folder.table[500, 0] = folder.table[499, 0]
    error = refusal(folder)
    assert (error.column, error.line) == ("time", 502)


def test_damaged_lines_outside_of_a_trial_do_not_matter(folder: Folder) -> None:
    # The first lines of a real log of a UR10e with a load: stamps and angles of 1e154 and more.
    folder.table[0, :] = 2.7e154
    folder.table[1, 2] = -1.1e282
    error = refusal(folder)
    assert (error.column, error.line) == ("time", 2)
    assert "leave damaged lines out by the trial's from and to" in str(error)
    folder.session["trials"] = [{"file": "a.csv", "from": 0.01, "to": 20.0}]
    (trial,) = load_session(folder.write()).session.trials
    assert trial.time[0] == pytest.approx(0.01) and len(trial.time) == len(folder.table) - 2


def test_milliseconds_are_refused(folder: Folder) -> None:
    folder.table[:, 0] *= 1000
    assert "milliseconds" in str(refusal(folder))


def test_degrees_are_refused(folder: Folder) -> None:
    folder.table[:, 2] = np.degrees(folder.table[:, 2])
    error = refusal(folder)
    assert error.column == "elbow.position" and "degrees" in str(error) and error.line is not None


MOTOR = """<mujoco><worldbody><body name="rotor"><joint name="shaft" axis="0 0 1"{range}/>
<inertial pos="0 0 0" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/></body></worldbody></mujoco>"""


def fast_motor(folder: Folder, *, declared: bool) -> None:
    """Turn the session into one of a bare motor of 1 300 turns a minute.

    Args:
        folder: of the session.
        declared: whether the model says how far it turns.
    """
    rng = np.random.default_rng(6)
    even = np.arange(4000) / 200.0
    taken = even.copy()
    # One that is late and does not say so, where the motor is fastest.
    taken[1001] += 3e-3
    angle = 5.0 * np.sin(27.0 * taken)
    effort = -1e-4 * 27.0**2 * angle + 0.02 * rng.standard_normal(len(even))
    folder.header = "time,shaft.position,shaft.effort"
    folder.table = np.column_stack([even, angle, effort])
    folder.model = MOTOR.format(range=' range="-400 400"' if declared else "")
    folder.session["declared_effects"] = []


def test_a_fast_motor_is_read_as_soon_as_its_range_is_declared(folder: Folder) -> None:
    """A stranger's did what was advised, and was refused for jumps at 117 rad/s, its own speed."""
    fast_motor(folder, declared=False)
    assert "give a motor that is so fast a `range`" in str(refusal(folder))
    fast_motor(folder, declared=True)
    assert load_session(folder.write()).top_speed[0] > 100.0


def test_a_fast_motor_is_read_where_its_velocity_agrees(folder: Folder) -> None:
    """A stranger's gearless motor, in rad beside rad/s, was refused as one in degrees."""
    fast_motor(folder, declared=False)
    velocity = 135.0 * np.cos(27.0 * folder.table[:, 0])
    folder.header = "time,shaft.position,shaft.velocity,shaft.effort"
    folder.table = np.insert(folder.table, 2, velocity, axis=1)
    (trial,) = load_session(folder.write()).session.trials
    assert any("its velocity agrees: if both are in degrees" in said for said in trial.repairs)
    folder.table[:, 1] = np.degrees(folder.table[:, 1])
    assert "degrees" in str(refusal(folder))


def turning_motor(folder: Folder) -> None:
    """Let it turn some three hundred turns, there and back, at up to 600 rad/s."""
    fast_motor(folder, declared=False)
    time, noise = folder.table[:, 0], np.random.default_rng(7).standard_normal(4000)
    phase = 0.2 * np.pi * time
    folder.table[:, 1] = 1000.0 * (1.0 - np.cos(phase))
    folder.table[:, 2] = 0.04 * np.cos(phase) + 0.01 * np.sin(phase) + 0.002 * noise


def test_a_motor_that_turns_on_and_on_is_read_in_radians_and_asked_about(folder: Folder) -> None:
    """A stranger's free motor in radians was refused, and in degrees, which was wrong, taken."""
    turning_motor(folder)
    (trial,) = load_session(folder.write()).session.trials
    (said,) = [said for said in trial.repairs if "goes through" in said]
    assert said.startswith("shaft goes through") and "if they are degrees" in said


def test_a_fast_joint_that_carries_another_is_no_motor_that_turns_on_and_on() -> None:
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    assert not device.is_last("shoulder") and device.is_last("elbow")


@pytest.mark.parametrize(("scale", "read"), [(2 * np.pi, True), (1.0, False)])
def test_a_fast_motor_is_read_where_its_column_says_the_unit(
    folder: Folder, scale: float, read: bool
) -> None:
    fast_motor(folder, declared=False)
    folder.header = "t [s],angle [rev],torque [Nm]"
    folder.table[:, 1] /= scale if read else 1.0
    folder.session["columns"] = {
        "map": {
            "time": {"from": "t [s]"},
            "shaft.position": {"from": "angle [rev]", "scale": scale},
            "shaft.effort": {"from": "torque [Nm]"},
        }
    }
    if read:
        assert load_session(folder.write()).top_speed[0] > 100.0
    else:
        assert "degrees" in str(refusal(folder))


def test_a_damaged_cell_of_a_fast_motor_is_still_found(folder: Folder) -> None:
    fast_motor(folder, declared=True)
    folder.table[500, 1] += 3.0
    error = refusal(folder)
    assert error.line == 502 and "remove the damaged rows" in str(error)


def test_of_many_damaged_cells_it_is_said_how_often_it_jumps(folder: Folder) -> None:
    """A stranger's trial had dozens of them, and each was one "which it does nowhere else"."""
    fast_motor(folder, declared=True)
    folder.table[[500, 700, 900], 1] += 3.0
    assert "the first of 6 among" in str(refusal(folder))


@pytest.mark.parametrize("times", [0.05, 0.5, 2.0, 20.0])
def test_a_clock_that_makes_another_speed_than_the_velocity_is_refused(
    folder: Folder, times: float
) -> None:
    """A log of an xMate7p that its folder calls 50 Hz is one of 1 kHz, not one in degrees."""
    step = float(folder.table[1, 0] - folder.table[0, 0])
    folder.table[:, 0] *= times
    error = refusal(folder)
    assert "clock" in str(error) and "degrees" not in str(error)
    assert f"samples are {step:.3g} s apart" in str(error)
    assert "the velocity's scale or the clock is wrong" in str(error)


def test_a_velocity_in_degrees_is_refused(folder: Folder) -> None:
    folder.table[:, 3] = np.degrees(folder.table[:, 3])
    error = refusal(folder)
    assert error.column == "elbow.velocity" and "degrees" in str(error)


def test_the_velocity_of_a_held_joint_whose_encoder_trembles_is_no_fault(folder: Folder) -> None:
    # A robot's filter leaves a twentieth of what the last digit does.
    digit = 1.5e-3 * np.random.default_rng(4).integers(0, 2, len(folder.table))
    folder.table[:, 1] += digit
    folder.header += ",shoulder.velocity"
    velocity = 0.04 * np.gradient(digit, folder.table[:, 0])
    folder.table = np.column_stack([folder.table, velocity])
    load_session(folder.write())


def test_a_robots_filter_may_take_half_of_how_a_held_joint_shakes(folder: Folder) -> None:
    """Of the unkind bench (4633, 4676): a clock is judged where a joint goes somewhere."""
    time = folder.table[:, 0]
    folder.table[:, 1] += 0.01 * np.sin(2.0 * np.pi * 4.0 * time)
    folder.header += ",shoulder.velocity"
    velocity = 0.5 * np.gradient(folder.table[:, 1], time)
    folder.table = np.column_stack([folder.table, velocity])
    load_session(folder.write())


def test_a_velocity_of_the_other_sign_is_refused(folder: Folder) -> None:
    folder.table[:, 3] *= -1
    error = refusal(folder)
    assert error.column == "elbow.velocity" and "sign" in str(error)


def test_an_effort_of_the_other_sign_is_refused(folder: Folder) -> None:
    folder.table[:, 4] *= -1
    error = refusal(folder)
    assert error.column == "elbow.effort" and "sign" in str(error)


def test_a_position_of_the_other_sign_is_refused(folder: Folder) -> None:
    folder.table[:, 2:4] *= -1
    assert "sign" in str(refusal(folder))


def test_a_saturated_effort_is_refused(folder: Folder) -> None:
    limit = np.quantile(folder.table[:, 4], 0.9)
    folder.table[:, 4] = np.minimum(folder.table[:, 4], limit)
    error = refusal(folder)
    first = int(np.argmax(folder.table[:, 4] == limit)) + 2
    assert error.column == "elbow.effort" and "saturated" in str(error)
    assert error.line is not None and error.line >= first


@pytest.mark.parametrize(("start", "line"), [(0, 2), (1000, 1002)])
def test_an_encoder_that_is_stuck_is_named(folder: Folder, start: int, line: int) -> None:
    folder.table[start:, 2] = folder.table[start, 2]
    error = refusal(folder)
    assert (error.column, error.line) == ("elbow.position", line)
    assert "look at the encoder" in str(error)


def test_a_held_joint_with_a_noisy_velocity_is_not_stuck(folder: Folder) -> None:
    """Of an opponent: white noise adds up to a walk of a tenth of a radian in 10 s."""
    folder.table[:1000, 2] = folder.table[1000, 2]
    rng = np.random.default_rng(0)
    step = folder.table[1, 0] - folder.table[0, 0]
    noise = 0.15 / (step * np.sqrt(1000.0))
    folder.table[:, 3] = np.gradient(folder.table[:, 2], step)
    folder.table[:, 3] += noise * rng.standard_normal(len(folder.table))
    load_session(folder.write())


def test_of_encoders_that_are_all_stuck_the_one_of_the_motor_that_works_is_named(
    folder: Folder,
) -> None:
    folder.table[:, 2] = folder.table[0, 2]
    folder.header = folder.header.replace("elbow.velocity", "note")
    assert refusal(folder).column == "elbow.position"


def test_a_coarse_encoder_is_not_stuck(folder: Folder) -> None:
    folder.table[:, 2] = np.round(folder.table[:, 2], 2)
    load_session(folder.write())


def test_a_quantised_effort_is_not_saturated() -> None:
    angle = np.linspace(0, 60, 5000)
    effort = np.round(np.sin(angle) / 0.05) * 0.05
    assert saturated_line(effort, angle) is None


def test_one_broad_peak_of_a_quantised_effort_is_not_saturated() -> None:
    angle = np.linspace(0, np.pi, 500)
    effort = np.round(np.sin(angle) / 0.03) * 0.03
    assert saturated_line(effort, angle) is None


def test_a_joint_that_is_held_is_not_saturated() -> None:
    shares = np.concatenate([np.linspace(0, 1, 100), np.ones(400)])
    noise = 1e-4 * np.random.default_rng(1).normal(size=500)
    effort = np.round(6.0 * shares / 0.06) * 0.06
    assert saturated_line(effort, 0.1 * shares + noise) is None
    assert saturated_line(effort, np.linspace(0, 1, 500)) == 101


@pytest.mark.parametrize("refused", [True, False])
def test_what_an_effort_exceeds_in_another_trial_is_no_limit(
    folder: Folder, *, refused: bool
) -> None:
    """A joint that is accelerated evenly stays on one step of a coarse effort, and was refused."""
    recording = load_session(folder.write())
    trial = recording.session.trials[0]
    effort = trial.columns["elbow.effort"]
    limit = float(np.quantile(effort, 0.9))
    clipped = {**trial.columns, "elbow.effort": np.minimum(effort, limit)}
    trials = [replace(trial, columns=clipped), trial]
    with pytest.raises(SessionError, match="saturated") if refused else nullcontext():
        check_saturated(trials[:1] if refused else trials, recording.device)


@pytest.mark.parametrize("column", ["elbow.effort", "elbow.position"])
def test_constant_signals_are_refused(folder: Folder, column: str) -> None:
    number = HEADER.split(",").index(column)
    folder.table[:, number] = 1.0
    if column == "elbow.position":
        folder.table[:, 3] = 0.0
    error = refusal(folder)
    assert "constant" in str(error) and error.line == 2


def test_a_constant_position_is_refused_if_the_velocity_says_that_the_joint_moves(
    folder: Folder,
) -> None:
    folder.table[:, HEADER.split(",").index("elbow.position")] = 1.0
    error = refusal(folder)
    assert (error.column, error.line) == ("elbow.position", 2)


def test_a_held_joint_beside_one_that_moves_without_an_effort_is_asked_for_pushes(
    folder: Folder,
) -> None:
    """Nothing can be fitted, which was refused; what the other's motion needs of it is no push."""
    time = folder.table[:, 0] - folder.table[0, 0]
    folder.table[:, 1] = 0.3 * np.sin(2 * np.pi * 0.5 * time)
    folder.table[:, 2:4] = 1.0, 0.0
    folder.table[:, 4] = 0.02 * np.random.default_rng(1).standard_normal(len(time))
    needed = load_session(folder.write())
    folder.table[:, 4] += np.interp(time, needed.time - needed.time[0], needed.inverse[:, 1])
    quiet = load_session(folder.write())
    assert quiet.still and quiet.joints == (1,) and np.ptp(quiet.inverse[:, 1]) > 1.0
    assert find_events(Model(quiet), quiet) == ()
    folder.table[800:1000, 4] += 1.0
    pushed = load_session(folder.write())
    (push,) = find_events(Model(pushed), pushed)
    assert (push.begin, push.end) == pytest.approx((4.0, 5.0), abs=0.25)


def test_joints_that_are_held_may_all_be_constant_and_the_trial_says_so(folder: Folder) -> None:
    """A good encoder shows no motion of a joint that does not move; pushes are looked for."""
    folder.table[:, 2:] = 1.0, 0.0, 3.0
    folder.table[:, 4] += 0.02 * np.random.default_rng(1).standard_normal(len(folder.table))
    folder.table[800:1000, 4] += 1.0
    recording = load_session(folder.write())
    assert recording.still and "look at the encoders" in recording.session.trials[0].repairs[0]
    (push,) = find_events(Model(recording), recording)
    assert (push.begin, push.end) == pytest.approx((4.0, 5.0), abs=0.25)
    assert push.peak == pytest.approx(1.0, rel=0.1)
    assert load_session(Folder(folder.path).write()).session.trials[0].repairs == ()


def test_a_motor_that_warms_up_or_is_pushed_holds_its_joint() -> None:
    time = np.arange(2000) / 200.0
    held = 3.0 + 0.01 * time + 0.002 * np.random.default_rng(1).standard_normal(2000)
    held[800:1600] += 1.0
    assert not works(held, time) and not works(np.full(2000, 3.0), time)
    assert not works(np.round(held, 2), time)
    assert works(held + 0.1 * np.sin(np.pi * time), time)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("schema", 2, "schema"),
        ("model", "/etc/passwd", "relative path"),
        ("model", "../device.xml", "leaves the session's folder"),
        ("model", "none.xml", "no such file"),
        ("trials", [], "at least one trial"),
        ("trials", [{"file": "/a.csv"}], "relative path"),
        ("trials", [{"file": "C:\\a.csv"}], "relative path"),
        ("trials", [{"file": "a.csv"}, {"file": "a.csv"}], "twice"),
        ("trials", [{"file": "a.csv", "role": "holdout"}], "every trial is a holdout"),
        ("trials", [{"file": "a.csv", "role": "test"}], "fit"),
        ("trials", [{"file": "a.csv", "effort_filter_hz": "5"}], "number"),
        ("effort_filter_hz", -5, "must be more than 0, not -5"),
        ("trials", [{"file": "a.csv", "added_mass": {"body": "leg", "mass_kg": 1}}], "leg"),
        ("trials", [{"file": "a.csv", "payload": {"name": "tool", "body": "leg"}}], "leg"),
        ("trials", [{"file": "a.csv", "payload": {"body": "forearm"}}], "payload.name"),
        ("ignored_joints", ["wrist"], "wrist"),
        ("gravity", [9.81, 0], "gravity must be three numbers in m/s2"),
        ("gravity", "down", "gravity must be three numbers in m/s2"),
        ("gravity", [0, 0, -981], "gravity must be more than -30 and at most 30, not -981"),
        ("gravity", [0, None, 9.81], "gravity must be a finite number"),
        (
            "declared_effects",
            [{"effect": "viscoelastic_joint", "joint": "wrist"}],
            "effects[0].joint",
        ),
        ("declared_effects", [{"effect": "magic", "joint": "elbow"}], "magic"),
    ],
)
def test_session_json_is_checked(folder: Folder, field: str, value: object, words: str) -> None:
    folder.session[field] = value  # type: ignore[assignment]
    assert words in str(refusal(folder))


def test_gravity_of_the_session_stands_for_the_model_s_own(folder: Folder) -> None:
    """A robot's description stands upright, whatever wall the robot hangs at."""
    folder.session["gravity"] = [9.81, 0, -0.5]
    assert load_session(folder.write()).gravity == pytest.approx([9.81, 0.0, -0.5])


def test_broken_json_is_found_by_line(folder: Folder) -> None:
    folder.write()
    (folder.path / "session.json").write_text('{"schema": 1,\n "model": }')
    with pytest.raises(SessionError) as caught:
        load_session(folder.path)
    assert caught.value.line == 2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<worldbody>", '<include file="x.xml"/><worldbody>', "include"),
        ("<worldbody>", '<extension><plugin plugin="p"/></extension><worldbody>', "plugin"),
        ('type="hinge"', 'type="ball"', "hinge and slide"),
        ("<mujoco", '<!DOCTYPE x [<!ENTITY a "b">]><mujoco', "entities"),
        ("</mujoco>", "", "not XML"),
        ('mass="2"', 'mass="0"', "MuJoCo refuses it"),
        ('mass="2"', 'mass="-2"', "has mass='-2'; none is below 0"),
    ],
)
def test_a_model_that_reaches_out_or_is_no_chain_is_refused(
    folder: Folder, old: str, new: str, words: str
) -> None:
    folder.model = folder.model.replace(old, new, 1)
    error = refusal(folder)
    assert words in str(error) and error.file == "device.xml"


def test_a_body_without_a_name_is_called_after_its_joint(folder: Folder) -> None:
    """A report that finds a load says where it hangs."""
    folder.model = folder.model.replace('<body name="forearm" ', "<body ", 1)
    assert load_session(folder.write()).device.bodies == ("world", "upper_arm", "elbow_link")


def test_unknown_columns_are_kept_to_explain_a_residual(folder: Folder) -> None:
    folder.header += ",wrist.position"
    folder.table = np.column_stack([folder.table, np.sin(folder.table[:, 0])])
    recording = load_session(folder.write())
    assert recording.extra_names == ("wrist.position",)


def test_nothing_is_interpolated_across_a_gap(folder: Folder) -> None:
    folder.table = np.delete(folder.table, slice(800, 1000), axis=0)
    recording = load_session(folder.write())
    assert len(recording.slices) == 2
    assert not np.any((recording.time > 4.0) & (recording.time < 4.98))


def test_an_ignored_joint_needs_no_column(folder: Folder) -> None:
    folder.session["ignored_joints"] = ["shoulder"]
    folder.header = HEADER.replace("shoulder.position", "other")
    recording = load_session(folder.write())
    assert recording.device.recorded_joints == ("elbow",)


def test_a_movement_that_goes_a_little_beyond_its_declared_range_is_a_warning(
    folder: Folder,
) -> None:
    folder.model = folder.model.replace(
        'name="elbow"', 'name="elbow" limited="true" range="0.9 2.5"'
    )
    (trial,) = load_session(folder.write()).session.trials
    assert any("of elbow.position is outside of the range" in line for line in trial.repairs)


def test_a_fault_is_said_of_its_trial_among_several_of_one_file(folder: Folder) -> None:
    """A stranger cut five trials of one file, and read of its line 2 in whichever it was."""
    time = folder.table[:, 0]
    middle = float(time[len(time) // 2])
    first = int(np.argmax(time >= middle))
    folder.table[first:, 4] = 0.0
    folder.session["trials"] = [
        {"file": "a.csv", "to": middle - 0.01},
        {"file": "a.csv", "from": middle},
    ]
    error = refusal(folder)
    assert error.column == folder.header.split(",")[4] and error.line == first + 2
    assert f"in the trial from {middle:g} s: is constant at 0" in str(error)
