"""Real recordings: a positioning axis with a worn screw, and stretches of healthy elbows."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.load import load_session
from analysis.closeloop.loop import analyse, close_loop
from analysis.closeloop.report.confirmation import simulate
from analysis.closeloop.session.recording import Recording
from benchmarks.closeloop.arms import BAND, held_out_errors
from tests.testbed.sessions.recordings import measured_folder, write_elbows, write_emps, write_ur10e

MEASURED = measured_folder()
pytestmark = pytest.mark.skipif(
    MEASURED is None, reason="no measured recordings: set REHYB_MEASURED to their folder"
)


def emps(folder: Path, joint: str) -> dict[str, Any]:
    """Analyse the positioning axis with `joint` attributes declared."""
    assert MEASURED is not None
    write_emps(folder, MEASURED, joint, ())
    return analyse(folder).report


def rubs_more(out: Path, recording: Recording, piece: slice) -> tuple[float, float]:
    """Return the mean force that the repaired model lacks against either direction, N."""
    file = recording.session.trials[recording.trial_of(piece)].file
    with (out / "residuals.csv").open() as lines:
        rows = [row for row in csv.DictReader(lines) if row["file"] == file]
    clock, left = np.array([[float(row["time"]), float(row["after"])] for row in rows]).T
    velocity = np.interp(clock, recording.time[piece], recording.velocity[piece, 0])
    fast = 0.2 * recording.top_speed[0]
    return float(left[velocity > fast].mean()), float(-left[velocity < -fast].mean())


def test_a_worn_screw_rubs_differently_each_way(tmp_path: Path) -> None:
    # Published symmetric values (Janot, Gautier and Brunot 2019).
    report = emps(tmp_path / "emps", 'frictionloss="20.39" damping="203.5"')
    assert report["verdict"] == "effect_found"
    assert report["effects"][0]["name"] == "asymmetric_friction"
    error = report["error"]["holdout"]["slide"]
    assert error["after"] < error["before"] and error["smooth_relative_after"] <= 0.0535


def test_the_same_form_fitted_has_the_published_errors_until_it_is_repaired(tmp_path: Path) -> None:
    declared = ("coulomb_friction", "viscous_friction", "torque_offset")
    assert MEASURED is not None
    write_emps(tmp_path / "emps", MEASURED, "", declared)
    report = close_loop(tmp_path / "emps", tmp_path / "emps" / "out")
    assert report["verdict"] == "effect_found"
    assert report["effects"][0]["name"] == "asymmetric_friction"
    # Published: 5.98 % for the symmetric model on the pulses that it was not fitted to.
    error = report["error"]["holdout"]["slide"]
    assert error["smooth_relative_before"] == pytest.approx(0.0595, abs=0.0005)
    assert error["smooth_relative_after"] <= 0.0535
    # A found friction beside a declared one is a difference: it may have either sign, and is used.
    simulated = report["simulation"]["joints"]["slide"]
    # Along the pulses it strays further than along what was fitted: there the carriage rubs more.
    assert simulated["open_loop"]["after"] < 0.0125
    recording = load_session(tmp_path / "emps")
    xml = (tmp_path / "emps" / "out" / "model_after.xml").read_text()
    train, pulses = recording.slices
    assert simulate(recording, xml, train, bandwidth=0.0).deviation[0] < 0.0055
    more = [rubs_more(tmp_path / "emps" / "out", recording, piece) for piece in (train, pulses)]
    assert max(map(abs, more[0])) < 0.3 < 0.9 < min(more[1])
    assert simulated["closed_loop"]["after"] < simulated["closed_loop"]["before"]
    # What the pulses excite beyond the carriage's rigid motion has no name.
    left = report["unexplained"]["slide"]
    assert [place["file"] for place in left["mostly_in"]] == ["test_pulses.csv"]
    assert left["band_hz"][0] > 15.0 and left["rms"] > 5.0


def test_without_declared_coulomb_friction_it_is_found_first(tmp_path: Path) -> None:
    report = emps(tmp_path / "emps", 'damping="203.5"')
    # The asymmetric form includes the Coulomb friction: 20.4 N in the published model.
    first = report["effects"][0]
    assert first["name"] == "asymmetric_friction"
    for side in ("torque_positive", "torque_negative"):
        assert first["parameters"][side]["value"] == pytest.approx(20.4, rel=0.15)
    error = report["error"]["holdout"]["slide"]
    assert error["after"] < 0.6 * error["before"]


def test_ramps_of_healthy_elbows_lack_inertia_and_nothing_else(tmp_path: Path) -> None:
    assert MEASURED is not None
    write_elbows(tmp_path, MEASURED)
    report = analyse(tmp_path).report
    assert [effect["name"] for effect in report["effects"]] == ["added_inertia"]
    # A forearm with hand: 0.05 to 0.12 kg m2 (Winter 2009); the lever of the cuff adds to it.
    assert 0.05 < report["effects"][0]["parameters"]["inertia"]["value"] < 0.15
    stiffness = report["impedance"]["elbow"]["stiffness"]
    assert stiffness["before"] < 0 < stiffness["after"]


def test_pushes_of_a_still_arm_are_events_with_their_times(tmp_path: Path) -> None:
    assert MEASURED is not None
    write_ur10e(tmp_path, MEASURED, {"pushed_while_still": "fit"})
    report = analyse(tmp_path).report
    assert report["verdict"] == "unexplained" and report["effects"] == []
    pushes = report["unexplained"]["shoulder_lift_joint"]["events"]
    # Seen by eye in the current of the second joint: 205, 209 and 213 s on the controller's clock.
    assert [round(push["from"] / 2) * 2 for push in pushes] == [206, 208, 212]
    assert all(push["peak"] > 50.0 for push in pushes)


def test_stiction_of_a_still_arm_is_no_event_and_says_nothing_of_the_model(tmp_path: Path) -> None:
    assert MEASURED is not None
    write_ur10e(tmp_path, MEASURED, {"still_hold": "fit"})
    report = analyse(tmp_path).report
    assert report["verdict"] == "not_identifiable"
    assert report["unexplained"] == {} and "no joint moves" in report["warnings"][0]


def test_no_joint_of_a_real_arm_is_predicted_worse_than_by_least_squares(tmp_path: Path) -> None:
    # Rows in which a joint turns were left out once, and with them how its friction turns.
    assert MEASURED is not None
    roles = {"pair_unloaded": "fit", "pair_loaded": "fit", "unloaded_20s_10harm": "fit"}
    roles["unloaded_20s_7harm"] = "holdout"
    write_ur10e(tmp_path, MEASURED, roles, load="pair_loaded")
    report = close_loop(tmp_path, tmp_path / "out")
    residuals = tmp_path / "out" / "residuals.csv"
    errors = held_out_errors(load_session(tmp_path), residuals, BAND["UR10e"])
    assert [name for name, (_, simple, closed) in errors.items() if closed > 0.95 * simple] == []
    # Weighed, not fitted: 2.805 kg (Mamedov and Mikhel 2020).
    low, high = report["declared"][0]["parameters"]["mass"]["ci90"]
    assert low < 2.805 < high


def test_a_load_that_no_trial_names_is_weighed_and_asked_for(tmp_path: Path) -> None:
    # One movement without and with it: the floor was 14.6 Nm, as if the load were noise.
    assert MEASURED is not None
    write_ur10e(tmp_path, MEASURED, {"pair_unloaded": "fit", "pair_loaded": "fit"})
    report = close_loop(tmp_path, tmp_path / "out")
    (load,) = report["unnamed_loads"]
    assert (load["file"], load["body"]) == ("pair_loaded.csv", "wrist_3_link") and load["fitted"]
    low, high = load["mass"]["ci90"]
    assert low < 2.805 < high < 1.1 * low
    assert report["floor"]["shoulder_lift_joint"]["value"] < 5.0
    assert any('"payload": {"name": "load 1"' in line for line in report["warnings"])
