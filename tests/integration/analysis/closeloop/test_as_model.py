"""A repaired robot is a model whose found numbers are uncertain as they were found."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.as_model import NothingToSampleError, write_model
from models.folder import ModelFolder, read_folder
from models.mjcf.simulate import Simulation
from sim.effects.catalogue import BY_NAME
from sim.effects.elements import add_constant
from tests.testbed.sessions.small import Folder

FRICTION = {"value": 2.0, "ci90": [1.5, 2.5], "unit": "Nm"}
OFFSET = {"value": 0.4, "ci90": [0.2, 0.6], "unit": "Nm"}
MASS = {"value": 0.4, "ci90": [0.2, 0.6], "unit": "kg"}
IMPEDANCE = {
    "stiffness": {"after": 4.0, "ci90_after": [3.0, 5.0], "unit": "Nm/rad"},
    "damping": {"after": 0.5, "ci90_after": None, "unit": "Nm s/rad"},
    "neutral_angle": {"after": 1.0, "ci90_after": [0.9, 1.1], "unit": "rad"},
}


def found(name: str, **parameters: object) -> dict[str, object]:
    return {"name": name, "joint": "elbow", "parameters": parameters}


@pytest.fixture
def session(tmp_path: Path) -> Path:
    (tmp_path / "session").mkdir()
    return Folder(tmp_path / "session").write()


def report(tmp_path: Path, session: Path, *effects: dict[str, object]) -> Path:
    """Write a report by hand: what `rehyb close-loop` writes of a session with these effects."""
    folder = tmp_path / "report"
    folder.mkdir()
    content = {
        "verdict": "effect_found" if effects else "adequate",
        "effects": list(effects),
        "declared": [],
        "impedance": {"elbow": IMPEDANCE},
    }
    spec = mujoco.MjSpec.from_file(str(session / "device.xml"))
    BY_NAME["joint_stiffness"].add(spec, "elbow", {"stiffness": 4.0, "torque_at_zero": -4.0})
    spec.joint("elbow").frictionloss = 2.0
    add_constant(spec, "torque_offset", "elbow", -0.4)
    (folder / "model_after.xml").write_text(spec.to_xml())
    (folder / "report.json").write_text(json.dumps(content))
    return folder


def test_its_numbers_are_uncertain_and_decide_the_torque_along_a_recorded_trial(
    tmp_path: Path, session: Path
) -> None:
    effects = (
        found("coulomb_friction", torque=FRICTION),
        found("torque_offset", torque=OFFSET),
        found("payload", mass=MASS),
    )
    lacks = write_model(session, report(tmp_path, session, *effects), tmp_path / "out", "arm")
    assert lacks == [
        "payload mass at elbow: is no single number in MJCF",
        "impedance damping at elbow: no interval",
    ]
    folder: ModelFolder = read_folder(tmp_path / "out")
    ranges = {f.name: (f.low, f.nominal, f.high) for f in folder.description.factors}
    assert ranges == {
        "elbow.coulomb_friction.torque": pytest.approx((1.5, 2.0, 2.5)),
        # What the motor must add, as what the joint feels.
        "elbow.torque_offset.torque": pytest.approx((-0.6, -0.4, -0.2)),
        "elbow.impedance.stiffness": pytest.approx((3.0, 4.0, 5.0)),
        "elbow.impedance.neutral_angle": pytest.approx((0.9, 1.0, 1.1)),
    }
    simulation = Simulation(folder)
    simulation.check_factors()
    nominal = simulation({})
    # The robot follows the trial: 0.5 and 0.1 rad to and fro about 1 rad, without falling behind.
    recorded = np.ptp(np.loadtxt(tmp_path / "out" / "path.csv", delimiter=",", skiprows=1)[:, 2])
    assert nominal["elbow.travel"] == pytest.approx(recorded, rel=0.02)
    more = simulation({"elbow.coulomb_friction.torque": 2.5})
    # Friction is against the motion throughout: its peak stands in the peak as a whole.
    rise = more["elbow.torque_peak"] - nominal["elbow.torque_peak"]
    assert rise == pytest.approx(0.5, abs=0.1)


def test_a_report_without_numbers_says_so(tmp_path: Path, session: Path) -> None:
    folder = report(tmp_path, session)
    content = json.loads((folder / "report.json").read_text()) | {"impedance": {}}
    (folder / "report.json").write_text(json.dumps(content))
    with pytest.raises(NothingToSampleError, match="nothing was found or fitted"):
        write_model(session, folder, tmp_path / "out", "arm")
