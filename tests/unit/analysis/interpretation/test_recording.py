"""What a robot recorded, from a simulation or from a clinic."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.recording import Recording, read_recording
from sim.assessment.assess import assess
from sim.assessment.nominal import nominal_spec
from sim.assessment.record import Record
from sim.robot.device import NESM
from tests.testbed.interpretation import written_session


@pytest.fixture(scope="module")
def record() -> Record:
    found = assess({"activation": 0.05}, fidelity="bushing").record
    assert found is not None
    return found


@pytest.fixture(scope="module")
def saved(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "a.npz"
    record.save(path)
    return path


def test_a_simulation_and_a_measured_session_of_it_are_one_recording(
    record: Record, saved: Path, tmp_path: Path
) -> None:
    simulated = read_recording(saved)
    measured = read_recording(written_session(tmp_path, record))
    assert measured.device == simulated.device == "nesm"
    assert measured.values() == pytest.approx(simulated.values(), abs=1e-6)


def changed(saved: Path, to: Path, **arrays: object) -> Path:
    with np.load(saved) as file:
        content = {name: file[name] for name in file.files} | arrays
    with to.open("wb") as target:
        np.savez(target, **{n: v for n, v in content.items() if v is not None})
    return to


@pytest.mark.parametrize(
    ("arrays", "sentence"),
    [
        (lambda own: {"theta_velocity": None}, "has no velocities"),
        (lambda own: {"motor_torque": None, "theta": None}, "has no theta, motor_torque"),
        (lambda own: {"joint": np.array(1)}, "is of the shoulder"),
        (lambda own: {"theta": own["theta"][:-1]}, "n rows and a column for each joint"),
        (lambda own: {"exo_joint": np.array(7)}, "n rows and a column for each joint"),
        (lambda own: {"theta": np.nan * own["theta"]}, "theta has values that are not finite"),
        (lambda own: {"time": own["time"][::-1]}, "time must rise"),
        (lambda own: {"time": 1000.0 * own["time"]}, "samples are 10 s apart: time must be in sec"),
        (lambda own: {"joint": np.array([3])}, "joint must be one whole number"),
        (lambda own: {"joint": np.array(np.nan)}, "joint must be one whole number"),
        (lambda own: {"exo_joint": np.array("J4")}, "exo_joint must be one whole number"),
        (lambda own: {"device": np.array(["nesm"])}, "device must be one name"),
        (lambda own: {"theta": own["theta"] + 1.0j}, "theta must be real numbers"),
        (lambda own: {"time": own["time"].astype(str)}, "time must be real numbers"),
        (lambda own: {"time": own["time"][:1]}, "has 1 sample: a recording has at least 10"),
        (lambda own: {"time": own["time"][:0]}, "has 0 samples: a recording has at least 10"),
        (lambda own: {"theta": 0.0 * own["theta"]}, "moves by 0.00 rad"),
        (
            lambda own: {"theta_velocity": 0.0 * own["theta_velocity"]},
            "the velocity of J1, J2, J3, J4 is the same in every",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_one_sentence(
    saved: Path, tmp_path: Path, arrays: Callable[[dict], dict], sentence: str
) -> None:
    with np.load(saved) as file:
        own = {name: file[name] for name in file.files}
    path = changed(saved, tmp_path / "b.npz", **arrays(own))
    with pytest.raises(InterpretationError, match=sentence) as raised:
        read_recording(path).values()
    assert "\n" not in str(raised.value)


def test_what_is_no_recording_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InterpretationError, match="no such file"):
        read_recording(tmp_path / "a.npz")
    with pytest.raises(InterpretationError, match="no such file or folder"):
        read_recording(tmp_path / "session")
    (tmp_path / "a.npz").write_text("angles")
    with pytest.raises(InterpretationError, match="is no recording"):
        read_recording(tmp_path / "a.npz")
    (tmp_path / "a.npz").write_bytes(b"")
    with pytest.raises(InterpretationError, match="is no recording"):
        read_recording(tmp_path / "a.npz")
    with (tmp_path / "a.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InterpretationError, match="is no recording"):
        read_recording(tmp_path / "a.npz")
    with pytest.raises(InterpretationError, match=r"session\.json"):
        read_recording(tmp_path)
    (tmp_path / "a.zip").write_text("angles")
    with pytest.raises(InterpretationError, match="zip"):
        read_recording(tmp_path / "a.zip")


def test_of_a_file_of_another_kind_it_is_said_what_is_taken(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("elbow")
    with pytest.raises(InterpretationError, match=r"notes\.txt is no recording: .*npz.*session"):
        read_recording(tmp_path / "notes.txt")


def test_a_session_without_velocities_is_one_sentence(record: Record, tmp_path: Path) -> None:
    with pytest.raises(InterpretationError, match=r"down\.csv has no J1\.velocity"):
        read_recording(written_session(tmp_path, record, without=".velocity"))


def test_a_session_whose_velocities_were_never_filled_in_is_one_sentence(
    record: Record, tmp_path: Path
) -> None:
    still = replace(record, theta_velocity=np.zeros_like(record.theta_velocity))
    with pytest.raises(InterpretationError, match=r"down\.csv: the velocity of J1, J2, J3, J4"):
        read_recording(written_session(tmp_path, still))


@pytest.mark.parametrize("times", [100.0, 1000.0])
def test_torques_that_are_not_in_nm_are_one_sentence_and_a_single_stray_one_is_replaced(
    record: Record, tmp_path: Path, times: float
) -> None:
    torque = record.motor_torque
    folder = written_session(tmp_path, replace(record, motor_torque=times * torque))
    with pytest.raises(
        InterpretationError,
        match=r"^down\.csv: the torque of J2 reaches \d+ Nm, and its motor in the nesm "
        r"gives 60 Nm at most: torques are in Nm$",
    ):
        read_recording(folder)
    stray = torque.copy()
    stray[200, 1] = times * 60.0
    written_session(tmp_path, replace(record, motor_torque=stray))
    assert read_recording(folder).replaced == {"torque of J2": 1}


def test_a_torque_beyond_its_motors_limit_is_no_other_unit(record: Record, tmp_path: Path) -> None:
    pushed = record.motor_torque + np.array([0.0, 0.0, 120.0, 0.0])
    read_recording(written_session(tmp_path, replace(record, motor_torque=pushed)))


def test_a_session_of_which_no_regression_can_be_made_is_one_sentence(
    record: Record, tmp_path: Path
) -> None:
    # Only the last samples, after the movement, have a velocity.
    velocity = np.zeros_like(record.theta_velocity)
    velocity[-3:] = 0.1
    with pytest.raises(InterpretationError, match=r"down\.csv: .*must change angle and velocity"):
        read_recording(written_session(tmp_path, replace(record, theta_velocity=velocity)))


ANOTHER = """<mujoco><worldbody><body name="shank"><joint name="knee" type="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.05 0.2" mass="3"/></body></worldbody></mujoco>"""


def test_a_session_of_another_joint_is_one_sentence(record: Record, tmp_path: Path) -> None:
    folder = written_session(tmp_path, record, model="knee.xml")
    (folder / "knee.xml").write_text(ANOTHER)
    with pytest.raises(InterpretationError, match=r"is of knee\.xml with knee"):
        read_recording(folder)


def declared(record: Record, folder: Path, model: str, **said: object) -> Recording:
    """Return what is read of a session that declares a robot."""
    written_session(folder, record, model="robot.xml")
    (folder / "robot.xml").write_text(model)
    session = json.loads((folder / "session.json").read_text()) | said
    (folder / "session.json").write_text(json.dumps(session))
    return read_recording(folder)


ROBOT = NESM.path.read_text()


FRAMES = ROBOT.replace('<site name="forearm_cuff"', '<body name="tool"/><site name="forearm_cuff"')


@pytest.mark.parametrize(
    "model",
    [ROBOT, FRAMES, nominal_spec().to_xml()],
    ids=["alone", "with a frame more", "with a limb"],
)
def test_a_declared_robot_that_is_the_banks_is_no_other(
    record: Record, tmp_path: Path, model: str
) -> None:
    found = declared(record, tmp_path, model)
    assert found.differs is None and found.unused == ()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass="0.494"', 'mass="2.0"', "the mass of the link of J4 is 2 kg, not 0.494"),
        ('damping="1"', 'damping="2"', "the damping of J4 is 2 Nm s/rad, not 1"),
        (
            'name="J3" axis="0 0 1"',
            'name="J3" axis="0 0.1 1"',
            "the axis of J3 is 0.995 -0.0995 0, not 1 0 0",
        ),
        (
            "-0.0006 0.1679 -0.03",
            "-0.0006 0.1879 -0.03",
            "the centre of all mass from the link on of J3",
        ),
        ("0.1108677 0.0689688 0.0569634", "0.1608677 0.1189688 0.0569634", "by its inertias J"),
        ('pos="0 0 -0.085"', 'pos="0 0 -0.133"', "upper_arm_cuff is 48 mm from where the bank's"),
        ('name="J4" axis', 'name="J4" frictionloss="2" axis', "the friction of J4 is 2 Nm, not 0"),
    ],
)
def test_a_declared_robot_that_is_another_says_in_which_number(
    record: Record, tmp_path: Path, old: str, new: str, words: str
) -> None:
    assert old in ROBOT
    found = declared(record, tmp_path, ROBOT.replace(old, new))
    assert found.differs is not None and words in found.differs
    assert "by robot.xml" in found.differs


def test_what_a_session_says_that_is_not_used_is_told(record: Record, tmp_path: Path) -> None:
    found = declared(
        record,
        tmp_path,
        ROBOT,
        subject={"height_m": 1.9},
        declared_effects=[
            {"effect": name, "joint": "J4"}
            for name in ("viscoelastic_joint", "coulomb_friction", "payload")
        ],
        effort_filter_hz=2.0,
        effort_filter=2.0,
    )
    # What none of a session's keys is called, is said, too; that a limb is there goes unsaid.
    assert found.unused == ("subject", "declared_effects", "effort_filter")
    assert found.loads == ("payload",) and found.effort_filter_hz == 2.0


LOAD = {"name": "bottle", "body": "link_4"}
MASS = {"body": "link_4", "mass_kg": 0.5, "position": [0.0, 0.0, 0.0]}


@pytest.mark.parametrize("load", [{"payload": LOAD}, {"added_mass": MASS}])
def test_a_trial_without_a_load_is_taken_first_and_else_the_load_is_told(
    record: Record, tmp_path: Path, load: dict
) -> None:
    loaded = {"file": "down.csv", "label": "loaded"} | load
    found = declared(record, tmp_path, ROBOT, trials=[loaded])
    assert found.loads == ("payload",)
    (tmp_path / "again.csv").write_text((tmp_path / "down.csv").read_text())
    found = declared(record, tmp_path, ROBOT, trials=[loaded, {"file": "again.csv"}])
    assert found.source.endswith("again.csv") and found.loads == ()


def test_a_session_that_holds_no_movement_says_why(record: Record, tmp_path: Path) -> None:
    folder = written_session(tmp_path, record)
    said = json.loads((folder / "session.json").read_text())
    said["trials"][0] |= {"from": 0.0, "to": 2.0}
    (folder / "session.json").write_text(json.dumps(said))
    with pytest.raises(
        InterpretationError, match=r"down\.csv: .*(at least 0\.25 rad|record longer)"
    ):
        read_recording(folder)


def test_a_velocity_is_compared_with_the_slope_of_its_angle(saved: Path) -> None:
    own = read_recording(saved)

    def checked(velocity: np.ndarray) -> tuple[float, float]:
        return replace(own, motion=replace(own.motion, velocity=velocity)).velocity_check()

    velocity = own.motion.velocity
    gain, off = own.velocity_check()
    assert gain == pytest.approx(1.0, abs=0.01)
    assert off < 0.01
    gain, off = checked(2.0 * velocity)
    assert gain == pytest.approx(2.0, abs=0.02)
    assert off > 0.2
    late = int(0.5 / (own.motion.time[1] - own.motion.time[0]))
    assert checked(np.roll(velocity, late, axis=0))[1] > 0.1
    with pytest.raises(InterpretationError, match="is not of its angle"):
        checked(-velocity)
