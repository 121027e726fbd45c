"""The classical measurement of a joint's stiffness: small random steps of a limb in a servo.

Kearney, Stein and Parameswaran 1997, Identification of intrinsic and reflex contributions to human
ankle stiffness dynamics: the servo prescribes the position, the limb answers with its inertia,
viscosity and stiffness, and some 40 ms later with a reflex that the muscle passes on as a low-pass
of second order does. Made by SciPy's filters, not by the law that is asked for.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import bilinear, butter, lfilter, sosfiltfilt

from analysis.closeloop.loop import analyse

RATE, SECONDS, TRIALS = 500.0, 15.0, 4
STIFFNESS, VISCOSITY, INERTIA, DECLARED = 60.0, 0.3, 0.0145, 0.0075
REFLEX, DELAY, MUSCLE_HZ = 25.0, 0.044, 2.6


def stepped(rng: np.random.Generator) -> np.ndarray:
    """Return random steps of 0.06 rad that a servo takes 50 ms for, rad, (n,)."""
    switches = rng.choice([-0.03, 0.03], int(SECONDS / 0.15))
    steps = np.repeat(switches, round(0.15 * RATE))
    return np.asarray(sosfiltfilt(butter(2, 12.0, fs=RATE, output="sos"), steps))


def reflex(velocity: np.ndarray) -> np.ndarray:
    """Return the muscle's torque against a stretch, which its critically damped low-pass passes."""
    stretched = np.concatenate([np.zeros(round(DELAY * RATE)), np.maximum(velocity, 0.0)])
    omega = 2.0 * np.pi * MUSCLE_HZ
    b, a = bilinear([omega**2], [1.0, 2.0 * omega, omega**2], RATE)
    return np.asarray(REFLEX * lfilter(b, a, stretched)[: len(velocity)])


def answer(folder: Path, *, active: bool, calibrated: bool) -> dict[str, Any]:
    """Return the report of an ankle with or without reflexes, by a transducer that is known or not.

    Its inertia is declared half as large as it is.
    """
    rng, trials = np.random.default_rng(8), []
    for number in range(TRIALS):
        position = stepped(rng)
        velocity = np.gradient(position, 1.0 / RATE)
        effort = INERTIA * np.gradient(velocity, 1.0 / RATE) + VISCOSITY * velocity
        effort += STIFFNESS * (position - 0.01) + 0.05 * rng.standard_normal(len(position))
        effort += reflex(velocity) if active else 0.0
        time = 20.0 * number + np.arange(len(position)) / RATE
        name = f"t{number}.csv"
        table = np.column_stack([time, position, effort])
        header = "time,ankle.position,ankle.effort"
        np.savetxt(folder / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == TRIALS - 1 else "fit"})
    (folder / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="ankle" axis="0 1 0"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{DECLARED} {DECLARED} {DECLARED}"/></body>'
        "</worldbody></mujoco>"
    )
    session: dict[str, Any] = {"schema": 1, "model": "device.xml", "trials": trials}
    session["declared_effects"] = [{"effect": "viscoelastic_joint", "joint": "ankle"}]
    if calibrated:
        session["sensors"] = {"ankle.effort": {"calibrated": True}}
    (folder / "session.json").write_text(json.dumps(session))
    return analyse(folder).report


def test_a_reflex_is_found_behind_its_muscle_and_no_longer_taken_for_stiffness(
    tmp_path: Path,
) -> None:
    """Without the muscle's low-pass no law explained it, and K was half as large again.

    So it was in five real ankles, with latencies of 45 to 59 ms and muscles of some 2 Hz.
    """
    report = answer(tmp_path, active=True, calibrated=True)
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert found.keys() == {"stretch_reflex", "added_inertia"}
    told = found["stretch_reflex"]
    assert told["delay"]["value"] == pytest.approx(DELAY, abs=0.003)
    assert told["activation_time"]["value"] == pytest.approx(0.5 / np.pi / MUSCLE_HZ, rel=0.05)
    assert told["gain"]["value"] == pytest.approx(REFLEX, rel=0.05)
    stiffness = report["impedance"]["ankle"]["stiffness"]
    assert stiffness["before"] > 1.2 * STIFFNESS
    assert stiffness["after"] == pytest.approx(STIFFNESS, rel=0.02)


@pytest.mark.parametrize("calibrated", [True, False])
def test_who_knows_that_an_effort_is_the_torque_itself_learns_the_stiffness(
    calibrated: bool, tmp_path: Path
) -> None:
    """Where no gravity pulls, a share of the torque and another inertia are one torque."""
    report = answer(tmp_path, active=False, calibrated=calibrated)
    stiffness = report["impedance"]["ankle"]["stiffness"]
    (found,) = report["effects"]
    could_move = {one["effect"] for one in report["identified"]["ankle"]["could_move"]}
    if calibrated:
        assert report["verdict"] == "effect_found" and found["name"] == "added_inertia"
        assert stiffness["after"] == pytest.approx(STIFFNESS, rel=0.01)
        assert "torque_gain" not in could_move | set(found["indistinguishable_from"])
    else:
        assert report["verdict"] == "not_identifiable"
        assert "torque_gain" in {found["name"], *found["indistinguishable_from"]}
