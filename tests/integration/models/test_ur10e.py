"""A public robot as its makers describe it: the URDF of a UR10e is a model as it stands."""

import csv
import json
import shutil
from pathlib import Path

import mujoco
import pytest

from models.folder import ModelError, read_folder
from models.mjcf.simulate import Simulation
from tests.testbed.sessions.recordings import measured_folder

MEASURED = measured_folder()
pytestmark = pytest.mark.skipif(
    MEASURED is None, reason="no measured recordings: set REHYB_MEASURED to their folder"
)
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@pytest.fixture
def ur10e() -> Path:
    assert MEASURED is not None
    return MEASURED / "ur10e"


def written(folder: Path, ur10e: Path, *, collisions: bool = False) -> Path:
    """Write a model that holds the robot where it stands with the torques that gravity asks."""
    folder.mkdir()
    shutil.copy(ur10e / "ur10e.urdf", folder)
    # Those of the same robot without meshes, by MuJoCo's inverse dynamics.
    model = mujoco.MjModel.from_xml_path(str(ur10e / "ur10e_no_meshes.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_inverse(model, data)
    holding = {
        f"{joint}_joint": float(data.joint(f"{joint}_joint").qfrc_inverse[0]) for joint in JOINTS
    }
    with (folder / "torque.csv").open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["time", *holding])
        lines.writerows([[0.0, *holding.values()], [1.0, *holding.values()]])
    (folder / "model.toml").write_text(
        f"""
[model]
name = "ur10e"
kind = "mjcf"
[[factors]]
name = "tool"
unit = "1"
low = 0.5
high = 20.0
nominal = 1.0
scales = ["body.wrist_3_link.mass", "body.wrist_3_link.inertia"]
[[factors]]
name = "lift_friction"
unit = "Nm"
low = 0.0
high = 50.0
nominal = 0.0
sets = ["joint.shoulder_lift_joint.frictionloss"]
[[outputs]]
name = "sagged"
unit = "rad"
sensor = "shoulder_lift_joint.position"
reduce = "range"
[mjcf]
file = "ur10e.urdf"
duration = 0.3
collisions = {json.dumps(collisions)}
[mjcf.controls]
"""
        + "\n".join(f'{j} = {{file = "torque.csv", column = "{j}"}}' for j in holding)
    )
    return folder


def test_it_stands_under_the_torques_that_gravity_asks_and_sags_under_a_tool(
    ur10e: Path, tmp_path: Path
) -> None:
    simulation = Simulation(read_folder(written(tmp_path / "ur10e", ur10e)))
    simulation.check_factors()
    assert simulation({})["sagged"] < 1e-3
    sagged = simulation({"tool": 20.0})["sagged"]
    assert sagged > 0.02
    assert simulation({"tool": 20.0, "lift_friction": 50.0})["sagged"] < 0.5 * sagged


def test_shapes_that_touch_and_are_missing_are_named(ur10e: Path, tmp_path: Path) -> None:
    folder = read_folder(written(tmp_path / "ur10e", ur10e, collisions=True))
    with pytest.raises(ModelError, match=r"collision/base\.stl.*`collisions = false`"):
        Simulation(folder)
