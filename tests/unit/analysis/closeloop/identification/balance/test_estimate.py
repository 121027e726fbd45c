"""What is known of a joint before an effect is tried that scales with it."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import Model, estimate_of, unfitted
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW


def term(recording: Recording, name: str, theta: dict[str, float]) -> Term:
    effect = BY_NAME[name]
    columns = effect.columns(unfitted(recording, ELBOW), theta)
    return Term(joint=ELBOW, columns=columns, kept=(0,), effect=effect, theta=theta)


def test_what_a_motor_carries_is_neither_its_own_nor_friction(recording: Recording) -> None:
    model = Model(recording).with_term(term(recording, "coulomb_friction", {"smooth": 0.02}))
    model = model.with_term(term(recording, "torque_offset", {}))
    carried = estimate_of(model, np.array([0.7, 0.3])).carried[:, ELBOW]
    own = recording.motor_inertia(ELBOW) * recording.acceleration[:, ELBOW]
    own = own + recording.motor_damping(ELBOW) * recording.velocity[:, ELBOW]
    np.testing.assert_allclose(carried, recording.rigid[:, ELBOW] - own + 0.3)


def test_what_a_motor_carries_is_not_late_though_its_effort_is_reported_late(
    recording: Recording,
) -> None:
    """Of a declared low-pass of the channel, and of a delay that was found."""
    late = Channel(
        candidate=Candidate(effect=BY_NAME["time_delay"], joint=ELBOW), theta={"delay": 0.05}
    )
    trials = tuple(replace(trial, effort_filter_hz=5.0) for trial in recording.session.trials)
    session = replace(recording.session, trials=trials)
    slow = Model(replace(recording, session=session, cache={}), channels=(late,))
    found = estimate_of(slow, np.empty(0))
    plain = estimate_of(Model(recording), np.empty(0))
    np.testing.assert_allclose(found.carried, plain.carried)
    assert not np.allclose(found.prediction[:, ELBOW], plain.prediction[:, ELBOW], atol=0.1)


def test_a_declared_low_pass_above_half_of_the_rate_is_late_all_the_same(
    recording: Recording,
) -> None:
    """Of a drive that logs more slowly than it filters: it was refused (an opponent's)."""
    trials = tuple(replace(trial, effort_filter_hz=150.0) for trial in recording.session.trials)
    session = replace(recording.session, trials=trials)
    model = Model(replace(recording, session=session, cache={}))
    ramp = {ELBOW: recording.time[:, None]}
    late = recording.time - model.transformed(ramp)[ELBOW][:, 0]
    np.testing.assert_allclose(late[10:], 1.0 / (2 * np.pi * 150.0), rtol=1e-6)
