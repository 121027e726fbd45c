"""A joint that seems not to rub is asked for what hides its friction."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.hidden import beside_friction
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.growing.steps import grow
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_recording

DELAY = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)


def joint(friction: float, late: float) -> tuple[Recording, Rows]:
    """An elbow with so much friction, Nm, whose effort comes so many seconds late."""
    still = rich_recording(20)
    velocity = still.velocity[:, ELBOW]
    torque = np.array(still.inverse)
    torque[:, ELBOW] += friction * np.tanh(velocity / 0.01) + 0.3 * velocity
    effort = still.shifted(torque, -late)
    effort += 0.02 * np.random.default_rng(5).standard_normal(effort.shape)
    recording = replace(still, effort=still.filtered(effort), cache={})
    recording = replace(recording, joints=(ELBOW,))
    return recording, select_rows(recording, (0,))


def found(recording: Recording, rows: Rows) -> tuple[Grown, Grown]:
    """What was found at first, nothing, and what beside friction."""
    declared = Model(recording)
    before = evaluate(declared, rows)

    def more(begun: Grown) -> Grown:
        return grow(begun, rows, before, lambda _: None, [DELAY])[0]

    begun = Grown(declared, before)
    return begun, beside_friction(begun, rows, more)


def test_a_delay_and_the_friction_that_it_hides_are_found_together() -> None:
    _, grown = found(*joint(1.0, 0.02))
    names = {step.taken.candidate.effect.name for step in grown.steps}
    assert names == {"time_delay", "coulomb_friction", "viscous_friction"}
    assert {c.key for c in grown.model.effects} == {step.key for step in grown.steps}
    (channel,) = grown.model.channels
    assert channel.theta["delay"] == pytest.approx(-0.02, abs=0.003)


def test_a_joint_with_friction_and_nothing_rare_stays_as_it_was_found() -> None:
    begun, grown = found(*joint(1.0, 0.0))
    assert grown is begun
