"""A richer law of friction stays only where something needs it."""

import numpy as np
import pytest

from analysis.closeloop.identification.arms.plain_friction import with_plain_friction
from analysis.closeloop.identification.balance.model import Candidate, Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import tried_alone
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.coupled import measured, moving

JOINT = 1


@pytest.mark.parametrize(
    ("backwards", "kept"),
    [
        (0.3, {"coulomb_friction", "viscous_friction"}),
        (0.5, {"asymmetric_friction"}),
    ],
    ids=["two equal levels", "two levels"],
)
def test_two_equal_levels_are_coulomb_and_viscous_friction(
    backwards: float, kept: set[str]
) -> None:
    robot = moving()
    velocity = robot.velocity[:, JOINT]
    effort = np.array(robot.inverse)
    effort[:, JOINT] += np.where(velocity > 0, 0.3, -backwards) * np.tanh(np.abs(velocity) / 0.01)
    effort[:, JOINT] += 0.2 * velocity
    loud = measured(robot, effort)
    rows = select_rows(loud, (0,))
    richer = Candidate(effect=BY_NAME["asymmetric_friction"], joint=JOINT)
    found = tried_alone(Model(loud), rows, richer)
    assert found is not None
    plain = with_plain_friction(found[0], rows)
    assert {(c.effect.name, c.joint) for c in plain.effects} == {(name, JOINT) for name in kept}
