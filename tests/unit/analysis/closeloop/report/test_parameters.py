"""What a gain of a joint does to the other values that are told of it."""

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.report.parameters import parameters_of, part_of
from sim.effects.rigid import point_mass
from tests.testbed.sessions.coupled import measured, moving, traced


def test_a_load_has_its_own_mass_beside_a_gain_of_the_joint_it_hangs_at() -> None:
    """It was told as the gain times its mass: the gain scales it as it does the links."""
    arm = moving()
    load = 0.3 * point_mass(np.array([0.15, 0.03, 0.0]))
    effort = arm.rigid + arm.link_torque(arm.body(1)) @ load
    effort[:, 1] /= 1.15
    recording = measured(arm, effort)
    (found,) = (step.taken for key, step in traced(recording).items() if key == ("payload", 1))
    rows = select_rows(recording, (0,))
    coefficients = evaluate(found.model, rows).coefficients
    fits = leave_out(found.model, rows, coefficients)
    told = parameters_of(found.model, coefficients, fits, part_of(found.model, found.candidate))
    assert told["mass"]["value"] == pytest.approx(0.3, rel=0.01)
    low, high = told["mass"]["ci90"]
    assert low <= 0.3 <= high
