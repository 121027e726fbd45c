"""Efforts of a whole arm in another unit are one gain, and no links of another mass."""

import numpy as np
import pytest

from analysis.closeloop.identification.arms.gains import gain_of_all, untold_gain
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from sim.effects.catalogue import LINK_INERTIA
from tests.testbed.sessions.coupled import measured, moving, traced


@pytest.mark.parametrize("gain", [1.5, 0.4])
def test_one_factor_of_all_efforts_is_a_gain_of_every_joint(gain: float) -> None:
    arm = moving()
    torque = arm.rigid + 0.3 * np.sign(arm.velocity) + 0.2 * arm.velocity
    recording = measured(arm, torque / gain)
    found = traced(recording)
    assert {("torque_gain", joint) for joint in range(3)} <= set(found)
    assert LINK_INERTIA not in {name for name, _ in found}
    model, rows = next(iter(found.values())).taken.model, select_rows(recording, (0,))
    coefficients = evaluate(model, rows).coefficients
    assert gain_of_all(model, coefficients, rows) == pytest.approx(gain, rel=0.02)
    (said,) = untold_gain(model, coefficients, rows)
    assert f"{1.0 / gain:.2f} times their declared mass" in said


def test_a_gain_of_one_joint_is_none_of_all() -> None:
    arm = moving()
    torque = arm.rigid + 0.3 * np.sign(arm.velocity)
    recording = measured(arm, torque * np.array([1.0, 0.7, 1.0]))
    found = traced(recording)
    assert ("torque_gain", 1) in found
    model, rows = next(iter(found.values())).taken.model, select_rows(recording, (0,))
    assert gain_of_all(model, evaluate(model, rows).coefficients, rows) is None
