"""What a robot recorded, from a simulation or from a clinic."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.recording import read_recording
from sim.assessment.assess import assess
from sim.assessment.record import Record
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


def test_a_session_without_velocities_is_one_sentence(record: Record, tmp_path: Path) -> None:
    with pytest.raises(InterpretationError, match=r"down\.csv has no J1\.velocity"):
        read_recording(written_session(tmp_path, record, without=".velocity"))


def test_a_session_whose_velocities_were_never_filled_in_is_one_sentence(
    record: Record, tmp_path: Path
) -> None:
    still = replace(record, theta_velocity=np.zeros_like(record.theta_velocity))
    with pytest.raises(InterpretationError, match=r"down\.csv: the velocity of J1, J2, J3, J4"):
        read_recording(written_session(tmp_path, still))


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
