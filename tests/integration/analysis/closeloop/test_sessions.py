"""Sessions with a known truth, from the command line to the four files."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from analysis.closeloop.contract import REPORT_FILES
from analysis.closeloop.loop import analyse, close_loop
from analysis.closeloop.report.unexplained import OF_EVENTS
from sim.effects.applied import AppliedEffects
from sim.effects.elements import add_applied, add_constant
from tests.testbed.sessions.closed import closed_without_page, closed_without_pictures
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.small import Folder
from tests.testbed.sessions.synthetic import write_session

SEED = 3
#: Hz: a quarter of what measurements of the method record; the bounds are the same.
RATE = 125.0


def found(tmp_path: Path, *effects: str, rate: float = RATE) -> tuple[dict[str, Any], Arm]:
    """Return what the analysis says, which takes a third as long as all files with pictures."""
    arm = write_session(tmp_path, SEED, effects, rate=rate)
    return analyse(tmp_path).report, arm


def test_coulomb_friction_is_found_added_and_the_error_falls(tmp_path: Path) -> None:
    arm = write_session(tmp_path / "session", SEED, ("coulomb_friction",), rate=RATE)
    report = close_loop(tmp_path / "session", tmp_path / "out")
    assert report["verdict"] == "effect_found"
    (effect,) = report["effects"]
    assert effect["name"] == "coulomb_friction" and effect["joint"] == "elbow"
    assert effect["mujoco_element"] == "joint/@frictionloss"
    torque = effect["parameters"]["torque"]
    assert torque["ci90"][0] <= torque["value"] <= torque["ci90"][1] and torque["unit"] == "Nm"
    error = report["error"]["holdout"]["elbow"]
    assert error["floor"] <= error["after"] < 0.5 * error["before"]
    stiffness = report["impedance"]["elbow"]["stiffness"]
    assert stiffness["after"] == pytest.approx(arm.stiffness, rel=0.015)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model_after.xml"))
    assert model.dof_frictionloss[1] == pytest.approx(torque["value"], rel=1e-4)
    assert model.jnt_stiffness[1] == pytest.approx(stiffness["after"], rel=1e-4)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(REPORT_FILES)
    # The model that was written follows the recording; the declared one needs to be pushed.
    simulated = report["confirmation"]["joints"]["elbow"]
    assert report["confirmation"]["ran"] and report["confirmation"]["trials"][0] == "holdout.csv"
    assert simulated["feedback_after"] < 0.3 * simulated["feedback_before"]
    assert simulated["deviation_after"] < 0.3 * simulated["deviation_before"]
    looked = report["diagnostics"]["elbow"]
    assert looked["before"]["depends_on"]["velocity sign"] > 0.6
    assert looked["after"]["depends_on"]["velocity sign"] < 0.2
    page = (tmp_path / "out" / "report.html").read_text()
    # It is the only one: nothing is said of shares that do not add up.
    assert "takes away: how much smaller" in page and "do not add up" not in page
    assert "coulomb_friction" in page and "data:image/png;base64," in page
    # The pictures' own letters may spell anything.
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == report


def test_nothing_missing_is_an_answer(tmp_path: Path) -> None:
    report, arm = found(tmp_path)
    assert report["verdict"] == "adequate" and report["effects"] == []
    error = report["error"]["holdout"]["elbow"]
    assert error["after"] == error["before"] == pytest.approx(0.06, rel=0.1)
    assert report["identified"]["elbow"]["stiffness"]
    assert report["identified"]["elbow"]["could_move"][0]["relative"] < 0.02
    # The sensor's own noise, seen above the band of the movement.
    assert report["floor"]["elbow"]["from"] == "above the band"
    assert error["floor"] == report["floor"]["elbow"]["value"] == pytest.approx(0.06, rel=0.2)
    assert report["impedance"]["elbow"]["stiffness"]["after"] == pytest.approx(
        arm.stiffness, rel=0.005
    )


def test_a_gain_that_a_payload_imitates_says_what_the_stiffness_would_be(tmp_path: Path) -> None:
    report, arm = found(tmp_path, "torque_gain", rate=500.0)
    (effect,) = report["effects"]
    names = {effect["name"], *effect["indistinguishable_from"]}
    assert names == {"torque_gain", "payload"}
    stiffness = report["impedance"]["elbow"]["stiffness"]
    low, high = stiffness["ci90_after"]
    assert low <= arm.stiffness <= high and " payload" in " ".join(report["warnings"])
    assert "known mass" in " ".join(report["advice"])


def test_two_effects_are_both_found(tmp_path: Path) -> None:
    report, arm = found(tmp_path, "coulomb_friction", "payload")
    names = {effect["name"]: effect for effect in report["effects"]}
    assert set(names) == {"coulomb_friction", "payload"}
    assert names["payload"]["parameters"]["distance"]["value"] == pytest.approx(0.24, rel=0.1)
    assert report["impedance"]["elbow"]["stiffness"]["after"] == pytest.approx(
        arm.stiffness, rel=0.015
    )


@pytest.mark.parametrize(
    "effects",
    [
        # Once named as friction that depends on the load, with a worse stiffness.
        ("coulomb_friction", "drift"),
        # Once named as a ripple and a nonlinear stiffness.
        ("end_range_torque", "coulomb_friction"),
    ],
)
def test_no_third_effect_stands_in_for_a_pair(tmp_path: Path, effects: tuple[str, ...]) -> None:
    report, arm = found(tmp_path, *effects)
    assert {effect["name"] for effect in report["effects"]} == set(effects)
    stiffness = report["impedance"]["elbow"]["stiffness"]
    assert stiffness["after"] == pytest.approx(arm.stiffness, rel=0.01)
    before, after = (abs(stiffness[word] - arm.stiffness) for word in ("before", "after"))
    assert after < before


def test_what_a_reflex_adds_is_not_taken_for_an_asymmetry_of_friction(tmp_path: Path) -> None:
    report, _ = found(tmp_path, "coulomb_friction", "stretch_reflex")
    assert {effect["name"] for effect in report["effects"]} == {
        "coulomb_friction",
        "stretch_reflex",
    }


def test_a_repaired_model_serves_a_later_session_and_says_what_that_leaves_out(
    tmp_path: Path,
) -> None:
    folder = Folder(tmp_path)
    spec = mujoco.MjSpec.from_string(folder.model)
    add_applied(spec, "torque_ripple", "elbow", {"sine": 0.3, "cosine": 0.1, "order": 14.0})
    add_constant(spec, "torque_offset", "elbow", -0.4)
    folder.model = spec.to_xml()
    report = analyse(folder.write()).report
    assert report["verdict"] == "adequate"
    assert report["warnings"][0] == (
        "device.xml has effects of an earlier repair that are not read from it (torque_ripple of "
        "elbow, torque_offset of elbow): name them in declared_effects to have them fitted again"
    )


def test_an_effect_without_a_native_element_runs_as_an_applied_torque(tmp_path: Path) -> None:
    write_session(tmp_path / "session", SEED, ("torque_ripple",), rate=RATE)
    report = closed_without_page(tmp_path / "session", tmp_path / "out")
    assert report["effects"][0]["name"] == "torque_ripple"
    assert report["effects"][0]["parameters"]["order"]["value"] == pytest.approx(14.0, rel=0.01)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model_after.xml"))
    data = mujoco.MjData(model)
    effects = AppliedEffects(model)
    for _ in range(100):
        effects.apply(data)
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all() and np.any(data.ctrl)


@pytest.mark.parametrize(
    ("effect", "signal"),
    [("tremor", "time"), ("muscle_bursts", "emg.biceps"), ("quadratic_drag", "elbow.velocity")],
)
def test_what_no_effect_explains_is_described_and_not_named(
    tmp_path: Path, effect: str, signal: str
) -> None:
    report, _ = found(tmp_path, effect, rate=2.0 * RATE)
    assert report["verdict"] == "unexplained" and report["effects"] == []
    left = report["unexplained"]["elbow"]
    assert signal in left["depends_on"] and left["rms"] > 0.1
    if effect == "tremor":
        assert left["band_hz"][0] < 6.3 < left["band_hz"][1]


def test_a_push_is_an_event_with_its_time_and_bends_no_stiffness(tmp_path: Path) -> None:
    arm = write_session(tmp_path / "session", SEED, ("push",), rate=RATE)
    report = closed_without_pictures(tmp_path / "session", tmp_path / "out")
    assert report["verdict"] == "unexplained" and report["effects"] == []
    first = report["unexplained"]["elbow"]["events"][0]
    # Every session's first trial is pushed, by at least 0.4 Nm at six times the noise.
    assert first["file"] == "p0_v0.csv" and abs(first["peak"]) > 0.3
    assert 0.1 < first["to"] - first["from"] < 2.5
    low, high = report["impedance"]["elbow"]["stiffness"]["ci90_after"]
    assert low <= arm.stiffness <= high
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Events: torque that is local in time" in page and "above the band" in page
    # Its size is over the pushes alone, and so may be larger than the error.
    assert report["unexplained"]["elbow"]["rms_of"] == OF_EVENTS and OF_EVENTS in page


def test_one_sweep_in_one_direction_names_nothing_and_says_what_to_record(tmp_path: Path) -> None:
    folder = tmp_path
    write_session(folder, SEED, ("coulomb_friction",), size=3.0, speeds=(0.8,), postures=(0.1,))
    lines = (folder / "p0_v0.csv").read_text().splitlines()
    position = np.array([float(line.split(",")[2]) for line in lines[1:]])
    turn = int(np.argmax(position > position.max() - 0.25)) + 300
    (folder / "p0_v0.csv").write_text("\n".join(lines[:turn]) + "\n")
    session = json.loads((folder / "session.json").read_text())
    session["trials"] = [{"file": "p0_v0.csv"}]
    (folder / "session.json").write_text(json.dumps(session))
    report = analyse(folder).report
    assert report["verdict"] == "not_identifiable"
    # What K, D and q0 imitate whole gets no name at all; what shows gets the set it may be one of.
    assert all(effect["indistinguishable_from"] for effect in report["effects"])
    assert any("to and fro" in line for line in report["advice"])
    error = report["error"]["fit"]["elbow"]
    assert error["after"] == error["before"]


def test_slow_sweeps_in_one_direction_do_not_identify_a_stiffness_and_say_what_hides(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "session"
    arm = write_session(
        folder, SEED, ("torque_gain",), size=0.6, speeds=(0.35, 0.5), postures=(0.1,), holdout=False
    )
    for path in folder.glob("*.csv"):
        lines = path.read_text().splitlines()
        position = np.array([float(line.split(",")[2]) for line in lines[1:]])
        turn = int(np.argmax(position > position.max() - 0.2))
        path.write_text("\n".join(lines[:turn]) + "\n")
    report = closed_without_page(folder, tmp_path / "out")
    assert report["verdict"] == "not_identifiable"
    entry = report["identified"]["elbow"]
    assert not entry["stiffness"] and "do not identify the stiffness" in " ".join(
        report["warnings"]
    )
    # As far as it says, the stiffness is off.
    off = abs(report["impedance"]["elbow"]["stiffness"]["after"] - arm.stiffness)
    assert off < entry["could_move"][0]["by"]
    assert any(line.startswith("To tell the stiffness of elbow") for line in report["advice"])


def test_the_command_prints_the_report_and_refuses_bad_input_with_2(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    write_session(folder, SEED, speeds=(0.8, 1.6), postures=(0.1,))

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "rehyb", "close-loop", str(folder), "--out", "out", "--json"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[4])},
            check=False,
        )

    path = folder / "p0_v1.csv"
    good = path.read_text()
    path.write_text(good.replace("\n", "\nnan", 1))
    refused = run()
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1 and "p0_v1.csv, column time, line 2" in refused.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["session"]
    path.write_text(good)
    done = run()
    assert done.returncode == 0 and json.loads(done.stdout)["verdict"] == "adequate"


def test_what_was_left_out_stands_among_the_warnings(tmp_path: Path) -> None:
    write_session(tmp_path / "s", 3, speeds=(0.8, 1.6), postures=(0.1,))
    path = tmp_path / "s" / "p0_v0.csv"
    path.write_text(path.read_text() + "7.0,0.1")
    report = closed_without_page(tmp_path / "s", tmp_path / "out")
    assert any(w.startswith("p0_v0.csv: line") and "cut off" in w for w in report["warnings"])
