"""Devices that MuJoCo simulates under a controller: friction sticks, loads bend the path."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from analysis.closeloop.loop import analyse, close_loop
from analysis.closeloop.report.repaired import repaired_model
from tests.testbed.sessions.plants import ARM, CARRIAGE, ELASTIC_ARM, LIMP_ARM, write_recordings

#: The file of the trial that carries more than the others.
LOADED = "loaded.csv"
#: Half a kilogram that hangs on the last link, that link's mass, and where it ends in the file.
LOAD = """<body pos="0.25 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/>
</body>"""
FORE = 'mass="1.4"'
LAST_LINK = "</body>\n    </body>"


def names(report: dict[str, Any]) -> set[tuple[str, str]]:
    return {(effect["name"], effect["joint"]) for effect in report["effects"]}


def test_nothing_is_missing_where_all_friction_is_declared(tmp_path: Path) -> None:
    write_recordings(tmp_path, CARRIAGE, 3)
    report = analyse(tmp_path).report
    assert report["verdict"] == "adequate"
    assert report["effects"] == []


def test_friction_that_sticks_is_coulomb_friction_and_no_late_motor(tmp_path: Path) -> None:
    truth = ARM.changed('frictionloss="0"', 'frictionloss="0.8"')
    write_recordings(tmp_path, ARM, 1, truth=truth)
    report = analyse(tmp_path).report
    assert names(report) == {("coulomb_friction", "elbow")}
    assert report["effects"][0]["parameters"]["torque"]["value"] == pytest.approx(0.8, rel=0.02)


def test_friction_beyond_the_declared_is_found(tmp_path: Path) -> None:
    truth = CARRIAGE.changed('frictionloss="10"', 'frictionloss="18"')
    write_recordings(tmp_path, CARRIAGE, 1, truth=truth)
    report = analyse(tmp_path).report
    assert names(report) == {("coulomb_friction", "slide")}
    assert report["effects"][0]["parameters"]["torque"]["value"] == pytest.approx(8.0, rel=0.02)


def test_a_spring_is_named_where_it_is_and_nothing_at_the_joint_that_feels_it(
    tmp_path: Path,
) -> None:
    """A stranger's arms had a neighbour's spring or offset named beside it, or in its place."""
    write_recordings(tmp_path, ARM, 3, truth=ELASTIC_ARM)
    report = analyse(tmp_path).report
    assert names(report) == {("series_elasticity", "shoulder")}
    compliance = report["effects"][0]["parameters"]["compliance"]["value"]
    assert compliance == pytest.approx(1 / 900.0, rel=0.05)


def test_a_spring_beside_a_load_that_nobody_declared_is_found_with_it(tmp_path: Path) -> None:
    """A stranger's had a load of twice its mass, and what rang was fourteen pushes."""
    assert LAST_LINK in ELASTIC_ARM
    truth = ELASTIC_ARM.replace(LAST_LINK, LOAD + LAST_LINK)
    write_recordings(tmp_path, ARM, 3, truth=truth)
    report = analyse(tmp_path).report
    assert names(report) == {("series_elasticity", "shoulder"), ("payload", "elbow")}
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert found["payload"]["mass"]["value"] == pytest.approx(0.5, rel=0.03)
    compliance = found["series_elasticity"]["compliance"]["value"]
    assert compliance == pytest.approx(1 / 900.0, rel=0.08)
    assert all(not left["events"] for left in report["unexplained"].values())


def test_springs_of_links_that_swing_against_each_other_are_both_found(tmp_path: Path) -> None:
    """A stranger's had one of nearly twice the compliance, and four pushes: asked alone, one takes
    most of what both do."""
    write_recordings(tmp_path, ARM, 3, truth=LIMP_ARM)
    report = analyse(tmp_path).report
    found = {effect["joint"]: effect for effect in report["effects"]}
    assert names(report) == {("series_elasticity", "shoulder"), ("series_elasticity", "elbow")}
    for joint, stiffness in (("shoulder", 900.0), ("elbow", 60.0)):
        compliance = found[joint]["parameters"]["compliance"]["value"]
        assert compliance == pytest.approx(1 / stiffness, rel=0.05)
    assert all(not left["events"] for left in report["unexplained"].values())


def test_springs_and_a_link_of_less_mass_than_declared_are_found_together(tmp_path: Path) -> None:
    """Other links stood for most of what a spring does: a stranger's had gains of all joints."""
    assert FORE in LIMP_ARM
    truth = LIMP_ARM.replace(FORE, FORE.replace("1.4", "1.09"))
    write_recordings(tmp_path, ARM, 3, truth=truth)
    report = analyse(tmp_path).report
    assert {name for name, _ in names(report)} == {"link_inertia", "series_elasticity"}
    found = {e["joint"]: e for e in report["effects"] if e["name"] == "series_elasticity"}
    for joint, stiffness in (("shoulder", 900.0), ("elbow", 60.0)):
        compliance = found[joint]["parameters"]["compliance"]["value"]
        assert compliance == pytest.approx(1 / stiffness, rel=0.06)


def test_a_mass_at_the_end_of_a_chain_is_found_through_both_joints(tmp_path: Path) -> None:
    truth = ARM.changed(LAST_LINK, LOAD + LAST_LINK)
    write_recordings(tmp_path, ARM, 1, truth=truth)
    report = analyse(tmp_path).report
    # All trials carry it: it is the robot's.
    assert names(report) == {("payload", "elbow")} and report["unnamed_loads"] == []
    assert report["effects"][0]["parameters"]["mass"]["value"] == pytest.approx(0.5, rel=0.03)


def test_a_gain_scales_what_a_load_takes_too(tmp_path: Path) -> None:
    """A stranger's 0.88 was 0.82 beside a load, and beside 1.1 a load of 1 kg was 0.82 kg."""
    write_recordings(tmp_path, ARM, 1, truth=ARM.changed(LAST_LINK, LOAD + LAST_LINK))
    for file in tmp_path.glob("trial_*.csv"):
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        header = file.read_text().split("\n", 1)[0]
        table[:, header.split(",").index("shoulder.effort")] /= 0.88
        np.savetxt(file, table, fmt="%.9g", delimiter=",", header=header, comments="")
    report = analyse(tmp_path).report
    assert names(report) == {("payload", "elbow"), ("torque_gain", "shoulder")}
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert found["payload"]["mass"]["value"] == pytest.approx(0.5, rel=0.03)
    assert found["torque_gain"]["gain"]["value"] == pytest.approx(0.88, abs=0.01)


def test_a_torque_from_the_other_joint_is_coupling_and_no_flipped_sign(tmp_path: Path) -> None:
    write_recordings(tmp_path, ARM, 1, beyond=lambda _t, q, _v: np.array([0.0, -1.2 * q[0]]))
    assert names(analyse(tmp_path).report) == {("cross_joint_coupling", "elbow")}


def test_a_differential_is_a_coupling_by_effort_both_ways_that_simulation_confirms(
    tmp_path: Path,
) -> None:
    """Each joint feels a share of the other's motor, which its own has to make up for."""
    write_recordings(tmp_path, ARM, 1, seconds=12.0, trials=5)
    felt = np.array([[1.0, 0.3], [0.1, 1.0]])
    for file in tmp_path.glob("*.csv"):
        header, *_ = file.read_text().splitlines()
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        efforts = [header.split(",").index(f"{joint}.effort") for joint in ARM.joints]
        table[:, efforts] = np.linalg.solve(felt, table[:, efforts].T).T
        np.savetxt(file, table, "%.9g", ",", header=header, comments="")
    report = close_loop(tmp_path, tmp_path / "found")
    assert names(report) == {("cross_joint_coupling", joint) for joint in ARM.joints}
    shares = {e["joint"]: e["parameters"]["effort_share"] for e in report["effects"]}
    assert shares["shoulder"]["value"] == pytest.approx(-0.3, rel=0.03)
    assert shares["elbow"]["value"] == pytest.approx(-0.1, rel=0.03)
    assert {share["unit"] for share in shares.values()} == {"1"}
    assert all(e["mujoco_element"].startswith("applied torque") for e in report["effects"])
    for joint in report["confirmation"]["joints"].values():
        assert joint["feedback_after"] < 0.2 * joint["feedback_before"]


def test_efforts_that_are_logged_early_at_all_joints_leave_nothing_to_explain(
    tmp_path: Path,
) -> None:
    """Each current is that of the control cycle after the encoder's beside it in the log."""
    write_recordings(tmp_path, ARM, 1)
    for file in tmp_path.glob("*.csv"):
        header, *_ = file.read_text().splitlines()
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        names = header.split(",")
        efforts = [names.index(f"{joint}.effort") for joint in ARM.joints]
        clock = table[:, names.index("time")]
        table[:, efforts] = CubicSpline(clock, table[:, efforts])(clock + 1e-3)
        np.savetxt(file, table, "%.9g", ",", header=header, comments="")
    report = analyse(tmp_path).report
    assert report["verdict"] == "adequate"
    (said,) = [line for line in report["warnings"] if "logged" in line]
    assert re.match(r"efforts are logged (1\.0\d|0\.9\d) ms before the positions", said)


def test_a_tremor_is_described_and_given_no_name(tmp_path: Path) -> None:
    def tremor(time: float, _q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.5 * np.sin(14.5 * time + 3.0 * np.sin(1.9 * time))])

    write_recordings(tmp_path, ARM, 1, beyond=tremor)
    report = analyse(tmp_path).report
    assert report["verdict"] == "unexplained"
    assert report["effects"] == []
    low, high = report["unexplained"]["elbow"]["band_hz"]
    assert low < 14.5 / (2 * np.pi) < high
    assert report["unexplained"]["elbow"]["rms"] == pytest.approx(0.5 / np.sqrt(2), rel=0.3)


def test_what_creeps_anew_in_every_trial_is_said_to_depend_on_its_time(tmp_path: Path) -> None:
    write_recordings(tmp_path, ARM, 1, beyond=lambda t, _q, _v: np.array([-t / 12.0, 0.0]))
    report = analyse(tmp_path).report
    assert "time in trial" in report["unexplained"]["shoulder"]["depends_on"]


def test_an_error_far_above_its_floor_is_unexplained_of_any_frequency(tmp_path: Path) -> None:
    """Faster than the fit's band nothing is judged: the table said 5 floors, and nothing else."""
    write_recordings(tmp_path, ARM, 1)
    session = json.loads((tmp_path / "session.json").read_text())
    session["sensors"] = {"elbow.effort": {"noise_rms": 0.2 * ARM.noise}}
    (tmp_path / "session.json").write_text(json.dumps(session))
    report = analyse(tmp_path).report
    assert (report["verdict"], report["effects"]) == ("adequate", [])
    error, (joint,) = report["error"]["holdout"]["elbow"], report["unexplained"]
    assert joint == "elbow" and error["after"] > 4.0 * error["floor"]
    left = report["unexplained"]["elbow"]
    assert left["rms"] ** 2 == pytest.approx(error["after"] ** 2 - error["floor"] ** 2)
    (said,) = [line for line in report["warnings"] if line.startswith("elbow: its error after")]
    assert f"{error['after'] / error['floor']:.1f} times the noise of its effort" in said


def test_every_joint_of_an_arm_gets_its_own_friction_and_no_joint_is_worse(tmp_path: Path) -> None:
    rubs = 'frictionloss="0.8" damping="1.5"'
    truth = ARM.mjcf.replace('armature="0.1"', f'armature="0.1" {rubs}')
    truth = truth.replace('frictionloss="0"', rubs)
    write_recordings(tmp_path, ARM, 1, truth=truth)
    report = analyse(tmp_path).report
    friction = ("coulomb_friction", "viscous_friction")
    assert names(report) == {(name, joint) for name in friction for joint in ARM.joints}
    assert report["unnamed_loads"] == []
    for error in report["error"]["holdout"].values():
        assert error["after"] < 0.5 * error["before"]


def test_links_that_are_not_as_declared_are_found_as_one(tmp_path: Path) -> None:
    truth = ARM.changed('pos="0.15 0 0" mass="3"', 'pos="0.2 0 0" mass="4"')
    truth = truth.replace('pos="0.13 0 0" mass="1.4"', 'pos="0.1 0 0.02" mass="2"')
    write_recordings(tmp_path, ARM, 1, truth=truth)
    answer = analyse(tmp_path)
    assert names(answer.report) == {("link_inertia", "shoulder")}
    assert [effect["where"] for effect in answer.report["effects"]] == ["the links"]
    assert answer.report["unnamed_loads"] == []
    xml, _, warnings = repaired_model(answer.recording.device, answer.report)
    assert warnings == []
    repaired, real = (mujoco.MjModel.from_xml_string(text) for text in (xml, truth))
    held = [np.empty(2), np.empty(2)]
    for model, torque in zip((repaired, real), held, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:] = ARM.centre
        mujoco.mj_inverse(model, data)
        torque[:] = data.qfrc_inverse
    assert held[0] == pytest.approx(held[1], rel=0.02, abs=0.05)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of an arm whose last fitted trial carries 0.5 kg."""
    folder = tmp_path_factory.mktemp("loaded")
    write_recordings(folder, ARM, 1)
    load = '<body pos="0.25 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/>'
    truth = ARM.changed("</body>\n    </body>", f"{load}</body></body>\n    </body>")
    write_recordings(folder / "loaded", ARM, 2, truth=truth, trials=1)
    header = (folder / "trial_0.csv").read_text().split("\n")[0]
    table = np.loadtxt(folder / "loaded" / "trial_0.csv", delimiter=",", skiprows=1)
    table[:, 0] += 1000.0
    np.savetxt(folder / LOADED, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return folder


def with_trial(folder: Path, out: Path, **words: Any) -> Path:
    """Copy a session, with the loaded trial besides, said of it what `words` are."""
    shutil.copytree(folder, out)
    session = json.loads((out / "session.json").read_text())
    session["trials"].append({"file": LOADED, **words})
    (out / "session.json").write_text(json.dumps(session))
    return out


def test_a_payload_that_trials_name_is_weighed_against_the_others(
    loaded: Path, tmp_path: Path
) -> None:
    payload = {"name": "weight", "body": "fore"}
    report = analyse(with_trial(loaded, tmp_path / "named", payload=payload)).report
    assert report["effects"] == [] and report["unnamed_loads"] == []
    (entry,) = report["declared"]
    mass, place = entry["parameters"]["mass"], entry["parameters"]["position"]
    assert (entry["effect"], entry["name"], entry["body"]) == ("payload", "weight", "fore")
    assert mass["value"] == pytest.approx(0.5, rel=0.1)
    assert mass["ci90"][0] <= 0.5 <= mass["ci90"][1]
    assert place["value"][0] == pytest.approx(0.25, abs=0.03)
    # The arm moves in a plane: no joint feels how far beside it the load is.
    assert place["value"][1] is None and "no joint feels it" in place["refused"]
    assert "gains" in entry["depends_on"]


def test_a_payload_that_its_trial_does_not_name_is_asked_for(loaded: Path, tmp_path: Path) -> None:
    report = analyse(with_trial(loaded, tmp_path / "unnamed")).report
    (entry,) = report["unnamed_loads"]
    assert (entry["file"], entry["body"]) == (LOADED, "fore")
    assert entry["mass"]["value"] == pytest.approx(0.5, rel=0.1)
    assert entry["position"]["value"][0] == pytest.approx(0.25, abs=0.03)
    assert report["verdict"] != "adequate"
    # What a load takes is no push.
    assert not any(left["events"] for left in report["unexplained"].values())
    assert any(LOADED in line and '"payload"' in line for line in report["warnings"])


def test_a_movement_made_again_with_a_load_is_no_repeat(tmp_path: Path) -> None:
    """Bare and loaded in two groups: half of the load went to the links of either."""
    load = '<body pos="0.25 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/>'
    truth = ARM.changed("</body>\n    </body>", f"{load}</body></body>\n    </body>")
    for name, chain in (("bare", ""), ("loaded", truth)):
        write_recordings(tmp_path / name, ARM, 1, truth=chain, trials=1, seconds=30.0)
        shutil.copy(tmp_path / name / "trial_0.csv", tmp_path / f"{name}.csv")
    shutil.copy(tmp_path / "bare" / "device.xml", tmp_path)
    trials = [{"file": f"{name}.csv", "group": name} for name in ("bare", "loaded")]
    session = {"schema": 1, "model": "device.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(session))
    report = analyse(tmp_path).report
    (entry,) = report["unnamed_loads"]
    assert (entry["file"], entry["body"], entry["fitted"]) == (LOADED, "fore", True)
    assert entry["mass"]["value"] == pytest.approx(0.5, rel=0.05)
    assert all(floor["value"] < 1.5 * ARM.noise for floor in report["floor"].values())
    assert report["effects"] == [] and report["declared"] == []
