"""What leaves a limb little torque, for its stiffness and damping take it in, and moves both."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.loop import analyse
from tests.testbed.sessions.plants import LIMB, change_efforts, write_recordings

STIFFNESS, DAMPING = 25.0, 0.3
ATTRIBUTES = 'armature="0.02" frictionloss="0"'
RATE = 200.0
#: A limb of so little inertia that it is a few thousandths of the effort.
LIGHT = replace(
    LIMB,
    mjcf=LIMB.changed(
        'mass="1.4" diaginertia="0.008 0.03 0.03"', 'mass="0.3" diaginertia="1e-3 1e-3 1e-3"'
    ),
    noise=0.05,
)


def answered(folder: Path, edit: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Return the answer to a session of a limb of which the log changed the effort by `edit`."""
    limp = f'springref="1.2" stiffness="{STIFFNESS}" damping="{DAMPING}"'
    truth = LIGHT.changed(ATTRIBUTES, f"{ATTRIBUTES} {limp}")
    write_recordings(folder, LIGHT, 2, truth=truth, rate=RATE, seconds=8.0, trials=4)
    session = json.loads((folder / "session.json").read_text())
    session["declared_effects"] = [{"effect": "viscoelastic_joint", "joint": "elbow"}]
    (folder / "session.json").write_text(json.dumps(session))
    change_efforts(folder, edit)
    return analyse(folder).report


def test_a_gain_of_which_stiffness_takes_in_nearly_all_is_told(tmp_path: Path) -> None:
    """`No catalogued effect explains what is left`, with K a quarter off and sure of it."""
    report = answered(tmp_path, lambda effort: 1.25 * effort)
    (effect,) = report["effects"]
    assert "torque_gain" in (effect["name"], *effect["indistinguishable_from"])
    low, high = report["impedance"]["elbow"]["stiffness"]["ci90_after"]
    assert low < STIFFNESS < high
    assert not report["identified"]["elbow"]["stiffness"]


def test_a_late_effort_of_which_damping_takes_in_nearly_all_is_told(tmp_path: Path) -> None:
    """It was called adequate with D a fifth of what it is, and sure of that."""
    late = round(0.01 * RATE)
    report = answered(
        tmp_path, lambda effort: np.concatenate([np.full(late, effort[0]), effort[:-late]])
    )
    assert [effect["name"] for effect in report["effects"]] == ["time_delay"]
    assert report["impedance"]["elbow"]["damping"]["after"] == pytest.approx(DAMPING, rel=0.1)
