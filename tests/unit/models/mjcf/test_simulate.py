"""An MJCF model is changed as its factors say, and its sensors are read as its outputs say."""

import struct
from math import pi
from pathlib import Path

import mujoco
import numpy as np
import pytest

from models.evaluation import ModelFailure
from models.folder import ModelError, read_folder
from models.mjcf.simulate import Simulation
from tests.testbed.models import EXAMPLES, edited


def simulation(scratch: Path, changes: dict[str, str], example: str = "pendulum") -> Simulation:
    """Return an example with other words in its files."""
    return Simulation(read_folder(edited(example, scratch, changes)))


def test_the_pendulum_comes_to_rest_where_its_torques_balance() -> None:
    pendulum = Simulation(read_folder(EXAMPLES / "pendulum"))
    for stiffness, gain in ((10.0, 1.0), (20.0, 0.8), (8.0, 1.2)):
        found = pendulum({"stiffness": stiffness, "motor_gain": gain})
        assert found["rest_angle"] == pytest.approx(gain * 0.5 / stiffness, rel=2e-3)


def test_points_do_not_depend_on_what_was_evaluated_before() -> None:
    pendulum = Simulation(read_folder(EXAMPLES / "pendulum"))
    first = pendulum({"mass": 1.1})
    pendulum({"stiffness": 5.0, "motor_gain": 0.8, "mass": 0.9})
    assert pendulum({"mass": 1.1}) == first


def test_a_mass_that_geoms_gave_can_be_set_and_scaled(tmp_path: Path) -> None:
    pendulum = Simulation(read_folder(EXAMPLES / "pendulum"))
    as_written = simulation(
        tmp_path,
        {"body.bob.mass": "geom.g.mass", '<geom type="capsule"': '<geom name="g" type="capsule"'},
    )
    assert pendulum({})["peak_speed"] == pytest.approx(as_written({})["peak_speed"], rel=1e-9)


def test_angles_are_in_radians_whatever_the_file_has(tmp_path: Path) -> None:
    sprung = simulation(
        tmp_path,
        {
            'sets = ["joint.hinge.stiffness"]': 'sets = ["joint.hinge.springref"]',
            "low = 5.0": "low = -1.0",
            "high = 20.0": "high = 1.0",
            "nominal = 10.0": "nominal = 0.0",
        },
    )
    found = sprung({"stiffness": pi / 4})
    assert found["rest_angle"] == pytest.approx(pi / 4 + 0.05, rel=1e-3)


@pytest.mark.parametrize(
    ("reduce", "expected"), [("first", 0.0), ("min", 0.0), ("range", 0.05), ("mean", 0.047)]
)
def test_a_sensor_is_reduced_as_its_output_says(
    tmp_path: Path, reduce: str, expected: float
) -> None:
    found = simulation(tmp_path, {'reduce = "last"': f'reduce = "{reduce}"'})({})
    assert found["rest_angle"] == pytest.approx(expected, abs=2e-3)


def test_a_curve_runs_over_time_or_over_a_sensor_that_grows(tmp_path: Path) -> None:
    over_time = Simulation(read_folder(EXAMPLES / "robot"))({})
    curve = [over_time[f"elbow_over_time[{i}]"] for i in range(11)]
    assert curve[0] == pytest.approx(0.0, abs=1e-3)
    turned_back = simulation(tmp_path, {'over = "time"': 'over = "elbow.velocity"'}, "robot")
    with pytest.raises(ModelFailure) as caught:
        turned_back({})
    assert caught.value.outcome == "axis_not_growing"


def test_a_point_that_mujoco_refuses_or_that_blows_up_is_a_named_failure(tmp_path: Path) -> None:
    pendulum = Simulation(read_folder(EXAMPLES / "pendulum"))
    with pytest.raises(ModelFailure) as caught:
        pendulum({"mass": -1.0})
    assert caught.value.outcome == "invalid_model"
    wild = simulation(
        tmp_path, {'timestep="0.002"': 'timestep="0.5"', "motor = 0.5": "motor = 1e12"}
    )
    with pytest.raises(ModelFailure) as caught:
        wild({})
    assert caught.value.outcome == "diverged"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"joint.hinge.stiffness": "joint.knee.stiffness"}, "there is no joint 'knee'; the file"),
        ({"joint.hinge.stiffness": "joint.hinge.softness"}, "softness is no number of it; it has"),
        ({"joint.hinge.stiffness": "joint.hinge.stiffness[9]"}, "has the entries 0 to 2"),
        ({"joint.hinge.stiffness": "wheel.hinge.size"}, "expected one of body, joint"),
        ({"joint.hinge.stiffness": "stiffness"}, "must be ELEMENT.NAME.ATTRIBUTE"),
        ({"body.bob.mass": "joint.hinge.stiffness"}, "factors stiffness and mass both change"),
        ({'sets = ["body.bob.mass"]': ""}, "must say what it `sets` or `scales`"),
        ({'sensor = "angle"': 'sensor = "torque"'}, "no sensor 'torque'; the file has angle"),
        ({'reduce = "last"': 'reduce = "median"'}, "must be one of first, last"),
        ({'reduce = "last"': ""}, "say either `reduce` or `curve`"),
        ({"motor = 0.5": "engine = 0.5"}, "no such actuator; the file has motor"),
        ({"motor = 0.5": 'motor = {file = "a.csv", column = "u"}'}, "not in the model's folder"),
        ({"duration = 2.0": "duration = 1e9"}, "steps of 0.002 s; at most"),
        (
            {"</sensor>": '<user name="u" dim="1000000"/></sensor>'},
            "1e+03 steps of 0.002 s, and its sensors give 1000002 numbers at each; at most",
        ),
        (
            {'reduce = "last"': "curve = 5", "duration = 2.0": "duration = inf"},
            "mjcf.duration must be a finite number of seconds",
        ),
        ({"duration = 2.0": 'duration = 2.0\nkeyframe = "start"'}, "no keyframe 'start'"),
        ({"duration = 2.0": "duration = 2.0\nspeed = 3"}, "mjcf.speed is unknown"),
        ({'file = "pendulum.xml"': 'file = "../pendulum.xml"'}, "not in the model's folder"),
        (
            {"<worldbody>": '<include file="a.xml"/><worldbody>'},
            "<include> is an included file; write one",
        ),
        (
            {"<worldbody>": '<worldbody><replicate count="9"/>'},
            "write one file, as mujoco.MjSpec.from_file('pendulum.xml').to_xml() returns it in",
        ),
        ({"<worldbody>": "<extension/><worldbody>"}, "<extension> is a plugin"),
        (
            {"<worldbody>": '<asset><mesh file="/etc/passwd"/></asset><worldbody>'},
            "names the file '/etc/passwd', which is not in the model's folder",
        ),
        ({"<worldbody>": "<worldbodies>"}, "is not XML"),
        ({"<mujoco": "<!DOCTYPE x><mujoco"}, "may not define a document type"),
        ({'<motor name="motor" joint="hinge"/>': '<motor name="m"/>'}, "MuJoCo refuses it"),
    ],
)
def test_what_is_wrong_in_the_files_is_one_sentence(
    tmp_path: Path, changes: dict[str, str], words: str
) -> None:
    with pytest.raises(ModelError) as caught:
        simulation(tmp_path, changes)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,u\n0,1\n\n0.1,fast\n", "line 4, column u: must be a finite number, not 'fast'"),
        ("time,u\n0,nan\n", "line 2, column u: must be a finite number, not 'nan'"),
        ("time,u\n0,1\n0.1\n", "line 3, column u: must be a finite number, not ''"),
        ("time,u\nsoon,1\n", "line 2, column time: must be a finite number, not 'soon'"),
        ("time,u\n0,1\n0.2,1\n0.1,1\n", "line 4, column time: must grow, and 0.1 follows 0.2"),
        ("time,u\n", "has no line of numbers under its header"),
        ("", "has no column 'time', which mjcf.controls.motor needs"),
        ("time,v\n0,1\n", "has no column 'u', which mjcf.controls.motor needs"),
    ],
)
def test_what_is_wrong_in_the_controls_is_told_by_line_and_column(
    tmp_path: Path, text: str, words: str
) -> None:
    folder = edited("pendulum", tmp_path, {"motor = 0.5": 'motor = {file = "a.csv", column = "u"}'})
    (folder / "a.csv").write_text(text)
    with pytest.raises(ModelError) as caught:
        Simulation(read_folder(folder))
    assert str(caught.value) == f"a.csv: {words}"


def test_a_model_of_many_files_is_written_as_one(tmp_path: Path) -> None:
    folder = edited(
        "pendulum", tmp_path, {"</worldbody>": '</worldbody><include file="more.xml"/>'}
    )
    (folder / "more.xml").write_text(
        '<mujoco><worldbody><replicate count="3" offset="1 0 0"><geom pos="9 0 0" size="0.1"/>'
        "</replicate></worldbody></mujoco>"
    )
    with pytest.raises(ModelError, match="<include> is an included file; write one file, as"):
        Simulation(read_folder(folder))
    whole = mujoco.MjSpec.from_file(str(folder / "pendulum.xml")).to_xml()
    (folder / "pendulum.xml").write_text(whole)
    assert Simulation(read_folder(folder))({}) == simulation(tmp_path / "as it was", {})({})


@pytest.mark.parametrize(
    ("attribute", "stated"),
    [("quat[1]", 'euler="30 0 0"'), ("fullinertia[1]", ""), ("pos[0]", "")],
)
def test_a_factor_that_arrives_nowhere_is_refused(
    tmp_path: Path, attribute: str, stated: str
) -> None:
    what = "geom.g" if attribute == "pos[0]" else "body.bob"
    changes = {
        "joint.hinge.stiffness": f"{what}.{attribute}",
        '<body name="bob">': f'<body name="bob" {stated}>',
        '<geom type="capsule"': '<geom name="g" type="capsule"',
        "low = 5.0": "low = 0.1",
        "high = 20.0": "high = 0.4",
        "nominal = 10.0": "nominal = 0.2",
    }
    with pytest.raises(ModelError, match="factor stiffness changes nothing"):
        simulation(tmp_path, changes).check_factors()


def test_the_last_reading_is_of_the_end(tmp_path: Path) -> None:
    clock = {'<jointpos name="angle" joint="hinge"/>': '<clock name="angle"/>'}
    found = simulation(tmp_path, clock | {"duration = 2.0": "duration = 0.5"})({})
    assert found["rest_angle"] == pytest.approx(0.5, abs=1e-9)


def test_meshes_are_found_beside_the_file_and_by_the_end_of_a_ros_path(tmp_path: Path) -> None:
    folder = edited(
        "robot",
        tmp_path,
        {
            '<link name="base"/>': '<link name="base"><collision><geometry>'
            '<mesh filename="package://two_link/meshes/base.stl"/></geometry></collision></link>',
        },
    )
    (folder / "meshes").mkdir()
    with pytest.raises(ModelError, match=r"not in the model's folder, as 'meshes/base\.stl' or"):
        Simulation(read_folder(folder))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 1e-3
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    stl = bytes(80) + struct.pack("<I", len(faces))
    for face in faces:
        stl += struct.pack("<12fH", 0.0, 0.0, 0.0, *corners[list(face)].ravel(), 0)
    (folder / "meshes" / "base.stl").write_bytes(stl)
    assert Simulation(read_folder(folder))({})["fallen"] > 0.0


def test_a_picture_that_unpacks_to_very_much_is_refused(tmp_path: Path) -> None:
    asset = '<asset><texture type="2d" file="big.png"/></asset><worldbody>'
    folder = edited("pendulum", tmp_path, {"<worldbody>": asset})
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + struct.pack(">II", 30000, 10000)
    (folder / "big.png").write_bytes(head + bytes(100))
    with pytest.raises(ModelError, match="a picture of 30000 x 10000 pixels; at most 17 million"):
        Simulation(read_folder(folder))


def test_steps_too_many_to_take_are_a_failure_of_that_point(tmp_path: Path) -> None:
    changes = {"joint.hinge.stiffness": "option.timestep", "low = 5.0": "low = 1e-12"}
    with pytest.raises(ModelFailure) as caught:
        simulation(tmp_path, changes)({"stiffness": 1e-9})
    assert caught.value.outcome == "invalid_model"
    assert "steps" in caught.value.reason
