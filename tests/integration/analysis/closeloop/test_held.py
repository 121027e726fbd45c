"""A device that is held all the time and pushed now and then: pushes are told, and nothing else."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.loop import close_loop
from tests.testbed.sessions.closed import closed_without_page

RATE, SECONDS, TRIALS = 100.0, 5.0, 4
#: A hobby servo's encoder, 12 bits a turn, rad.
STEP = 2.0 * np.pi / 4096


def held(folder: Path, declared: list[dict[str, str]]) -> dict[str, Any]:
    """Return the report of a joint that its controller holds, pushed in the first of four trials.

    Its encoder flickers between two steps, which is faster than a hundredth of what the push does.
    """
    rng, trials = np.random.default_rng(12), []
    for number in range(TRIALS):
        time = 10.0 * number + np.arange(int(RATE * SECONDS)) / RATE
        since = (time - 2.0) / 0.9
        push = np.where((since > 0) & (since < 1), 20.0 * np.sin(np.pi * since) ** 2, 0.0)
        away = 0.05 * push / 20.0 + 4e-4 * rng.standard_normal(len(time))
        effort = -push + 0.3 * rng.standard_normal(len(time))
        table = np.column_stack([time, STEP * np.round((away + STEP / 2) / STEP), effort])
        header = "time,elbow.position,elbow.effort"
        name = f"t{number}.csv"
        np.savetxt(folder / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == TRIALS - 1 else "fit"})
    (folder / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="elbow" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="2"/></body></worldbody>'
        "</mujoco>"
    )
    content = {"schema": 1, "model": "device.xml", "trials": trials}
    (folder / "session.json").write_text(json.dumps(content | {"declared_effects": declared}))
    return close_loop(folder, folder / "out")


@pytest.mark.parametrize("limb", [False, True], ids=["a robot", "a limb"])
def test_a_push_of_what_a_coarse_encoder_sees_is_told_and_nothing_is_fitted(
    tmp_path: Path, limb: bool
) -> None:
    """The push of 20 Nm was called adequate, or made a stiffness of."""
    declared = [{"effect": "viscoelastic_joint", "joint": "elbow"}] if limb else []
    report = held(tmp_path, declared)
    assert report["verdict"] == "unexplained" and report["effects"] == []
    (event,) = report["unexplained"]["elbow"]["events"]
    assert event["file"] == "t0.csv" and 1.9 < event["from"] < 2.5 < event["to"] < 3.0
    assert report["impedance"] == {}
    assert any("no joint moves long enough" in line for line in report["warnings"])


def test_a_movement_of_less_than_a_second_that_goes_far_is_fitted(tmp_path: Path) -> None:
    """As the 0.6 s of a Kinova Gen3 that its joints' torque sensors recorded."""
    rng, trials = np.random.default_rng(4), []
    for number in range(2):
        time = 2.0 * number + np.arange(80) / RATE
        position = 0.75 * (1.0 - np.cos(np.pi * (time - time[0]) / 0.8))
        velocity = np.gradient(position, 1 / RATE)
        effort = 0.5 * np.gradient(velocity, 1 / RATE) + 0.05 * rng.standard_normal(80)
        header, name = "time,elbow.position,elbow.effort", f"t{number}.csv"
        table = np.column_stack([time, position, effort])
        np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number else "fit"})
    (tmp_path / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="elbow" axis="0 1 0"/>'
        '<inertial mass="1" pos="0 0 0" diaginertia=".5 .5 .5"/></body></worldbody></mujoco>'
    )
    content = {"schema": 1, "model": "device.xml", "trials": trials}
    (tmp_path / "session.json").write_text(json.dumps(content))
    report = close_loop(tmp_path, tmp_path / "out")
    assert not any("no joint moves long enough" in line for line in report["warnings"])
    assert report["verdict"] != "unexplained"


@pytest.mark.parametrize("pushed", [False, True], ids=["by its motor alone", "and pushed once"])
def test_quick_pulses_of_a_motor_out_of_a_hold_are_no_pushes(tmp_path: Path, pushed: bool) -> None:
    """A stranger's: every pulse was an event, where inertia takes more than the stiffness."""
    rng, trials, (inertia, damping, stiffness) = np.random.default_rng(5), [], (0.06, 0.15, 2.0)
    for number in range(5):
        time = 20.0 * number + np.arange(20000) / 2000.0
        position = np.zeros(len(time))
        for begin in 20.0 * number + np.arange(0.8, 9.0, 1.1):
            part = np.clip((time - begin) / 0.15, 0.0, 1.0) - np.clip(
                (time - begin - 0.17) / 0.15, 0.0, 1.0
            )
            position += rng.choice([-0.12, 0.12, 0.2]) * part**3 * (10 - 15 * part + 6 * part**2)
        since = (time - 20.0 - 1.3) / 0.5
        push = 2.0 * np.sin(np.pi * since) ** 2 * (pushed & (since > 0) & (since < 1))
        position += 0.004 * push
        velocity = np.gradient(position, time)
        effort = inertia * np.gradient(velocity, time) + damping * velocity + stiffness * position
        effort += 0.05 * rng.standard_normal(len(time)) - push
        header, name = "time,elbow.position,elbow.effort", f"t{number}.csv"
        table = np.column_stack([time, np.round(position / 2e-5) * 2e-5, effort])[::10]
        np.savetxt(tmp_path / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == 4 else "fit"})
    (tmp_path / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="elbow" axis="0 1 0"/>'
        '<inertial mass="1" pos="0 0 0" diaginertia=".06 .06 .06"/></body></worldbody></mujoco>'
    )
    declared = [{"effect": "viscoelastic_joint", "joint": "elbow"}]
    content = {"schema": 1, "model": "device.xml", "trials": trials, "declared_effects": declared}
    (tmp_path / "session.json").write_text(json.dumps(content))
    report = closed_without_page(tmp_path, tmp_path / "out")
    events = report["unexplained"].get("elbow", {}).get("events", [])
    assert len(events) == int(pushed)
    assert all(21.2 < event["from"] < 21.6 < event["to"] < 21.9 for event in events)
    assert report["effects"] == []
    assert report["impedance"]["elbow"]["stiffness"]["after"] == pytest.approx(2.0, rel=0.02)
