"""Friction of one joint gets its names and its values, as of several."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.loop import close_loop

RATE, INERTIA, COULOMB, VISCOUS = 200.0, 0.06, 0.3, 0.2
#: What there is more of it when slow, Nm; where that is lost, rad/s; how far bristles bend, rad.
EXCESS, SPEED, WAY = 0.15, 0.12, 6e-4
#: Steps of bristles in a sample.
FINE = 50


def answer(folder: Path, friction: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Close the loop on three smooth trials of a joint; friction is that of positions, (n,)."""
    rng, trials = np.random.default_rng(3), []
    for number, (slow, quick) in enumerate([(0.35, 0.9), (0.3, 1.1), (0.4, 0.8)]):
        time = 20.0 * number + np.arange(int(9.0 * RATE)) / RATE
        q = 0.5 * np.sin(2 * np.pi * slow * time) + 0.15 * np.sin(2 * np.pi * quick * time)
        acceleration = np.gradient(np.gradient(q, 1 / RATE), 1 / RATE)
        effort = INERTIA * acceleration + friction(q)
        effort += 0.02 * rng.standard_normal(len(time))
        name = f"t{number}.csv"
        table = np.column_stack([time, q + 2e-5 * rng.standard_normal(len(time)), effort])
        header = "time,elbow.position,elbow.effort"
        np.savetxt(folder / name, table, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == 2 else "fit"})
    (folder / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="elbow" axis="0 1 0"/>'
        '<inertial mass="1" pos="0 0 0" diaginertia=".06 .06 .06"/></body></worldbody></mujoco>'
    )
    content = {"schema": 1, "model": "device.xml", "trials": trials}
    (folder / "session.json").write_text(json.dumps(content))
    return close_loop(folder, folder / "out")


def sliding(q: np.ndarray) -> np.ndarray:
    v = np.gradient(q, 1 / RATE)
    return COULOMB * np.tanh(v / 0.005) + VISCOUS * v


def larger_when_slow(q: np.ndarray) -> np.ndarray:
    """LuGre: bristles that bend by less, the less the joint's speed lets them hold."""
    step = 1.0 / (RATE * FINE)
    speed = np.interp(np.arange(len(q) * FINE) / FINE, np.arange(len(q)), np.gradient(q, 1 / RATE))
    level = COULOMB + EXCESS * np.exp(-((speed / SPEED) ** 2))
    found, bent = np.empty(len(speed)), 0.0
    for i, (v, most) in enumerate(zip(speed, level, strict=True)):
        bent = (bent + step * v) / (1.0 + step * abs(v) * COULOMB / (WAY * most))
        found[i] = bent
    return np.asarray((COULOMB / WAY * found + VISCOUS * speed)[::FINE])


def test_one_joint_in_three_smooth_trials_has_no_asymmetric_friction(tmp_path: Path) -> None:
    """Nine of fifteen sessions of an opponent had two equal levels: each name alone is worse."""
    report = answer(tmp_path, sliding)
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert set(found) == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"]["torque"]["value"] == pytest.approx(COULOMB, rel=0.05)
    assert found["viscous_friction"]["damping"]["value"] == pytest.approx(VISCOUS, rel=0.08)


def test_one_joint_that_moves_quickly_shows_its_excess_where_it_turns(tmp_path: Path) -> None:
    report = answer(tmp_path, larger_when_slow)
    found = {effect["name"]: effect["parameters"] for effect in report["effects"]}
    assert set(found) == {"stribeck_friction", "viscous_friction"}
    law = {name: one["value"] for name, one in found["stribeck_friction"].items()}
    assert law["torque"] == pytest.approx(COULOMB, rel=0.05)
    assert law["breakaway_excess"] == pytest.approx(EXCESS, rel=0.25)
    assert law["stribeck_velocity"] == pytest.approx(SPEED, rel=0.25)
    assert found["viscous_friction"]["damping"]["value"] == pytest.approx(VISCOUS, rel=0.05)
