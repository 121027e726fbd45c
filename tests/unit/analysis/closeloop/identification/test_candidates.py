"""Every effect is found again in rich data."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.identification.candidates import (
    _try,
    options_beside,
    refined,
    tried_alone,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, EFFECTS
from sim.effects.effect import Theta
from tests.testbed.sessions.rich import ELBOW, TRUTH, asked, swung, torque

#: Parameters that rich data tell.
PLAIN = ("delay", "time_constant", "distance", "aside", "centre", "onset", "width", "decades")
#: A lag between two of those that are tried first, s.
LAG = 0.0236
#: Three joints about parallel axes.
CHAIN = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body pos=".2 0 0"><joint name="b" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body pos=".2 0 0"><joint name="c" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
</body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("name", [effect.name for effect in EFFECTS])
def test_an_effect_is_found_again_in_rich_data(name: str, recording: Recording) -> None:
    effect, (theta, coefficients) = BY_NAME[name], TRUTH[name]
    recording = asked(recording, name)
    candidate = Candidate(effect=effect, joint=ELBOW)
    if effect.channel:
        channel = Channel(candidate=candidate, theta=theta)
        known = Model(recording, channels=(channel,)).known()
        effort = np.column_stack([known[joint][:, 0] for joint in (0, 1)])
    else:
        effort = recording.inverse + torque(recording, name)
    noise = 0.01 * np.random.default_rng(1).standard_normal(effort.shape)
    measured = replace(recording, effort=recording.filtered(effort + noise), cache={})
    rows = select_rows(measured, (0,))
    model = Model(measured)
    estimate = unfitted(measured, ELBOW).estimate
    option = _try(model, rows, candidate, estimate, evaluate(model, rows))
    assert option is not None and option.gain > 0.9 * evaluate(model, rows).loss
    better, scored = refined(option, rows)
    last: Theta = better.channels[-1].theta if effect.channel else better.terms[-1].theta
    if not effect.uses_estimate:
        for key, value in theta.items():
            # Some widths and levels are choices of the grid that hardly change the torque.
            if key in PLAIN:
                assert last[key] == pytest.approx(value, rel=0.15)
    expected = effort - recording.inverse
    left = better.target(rows) - better.base(rows)[0] @ scored.coefficients
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(expected**2)) + 0.01
    if coefficients and name in ("viscous_friction", "added_inertia", "torque_offset", "drift"):
        assert scored.coefficients == pytest.approx(coefficients, rel=0.05)


@pytest.mark.parametrize(("slow", "spread"), [(1.0, False), (0.3, True)])
def test_times_of_tissue_are_spread_only_where_that_leaves_less(
    slow: float, spread: bool, recording: Recording
) -> None:
    """Beside a single time what two do was a stiffness, 10 % too high, and sure of it."""
    effect = BY_NAME["stress_relaxation"]
    joint = unfitted(recording, ELBOW)
    effort = np.array(recording.inverse)
    for time in (0.3, 0.3 / slow**2):
        effort[:, ELBOW] += 2.0 * effect.columns(joint, {"relaxation_time": time})[ELBOW][:, 0]
    effort += 0.01 * np.random.default_rng(1).standard_normal(effort.shape)
    measured = replace(recording, effort=recording.filtered(effort), cache={})
    rows, model = select_rows(measured, (0,)), Model(measured)
    candidate = Candidate(effect=effect, joint=ELBOW)
    (option,) = options_beside(model, rows, evaluate(model, rows), [candidate])
    assert ("decades" in option.theta) is spread


def test_a_load_is_looked_for_where_the_robot_reaches(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What would fit best beyond does not rule out a nearer one: unweighed, all fit alike."""
    payload = Candidate(effect=BY_NAME["payload"], joint=ELBOW)
    far = payload.effect.columns(unfitted(recording, ELBOW), {"distance": 3.0})
    effort = recording.inverse + np.column_stack([0.1 * far[joint] for joint in (0, 1)])
    measured = replace(recording, effort=recording.filtered(effort), cache={})
    monkeypatch.setattr(Recording, "reach", lambda self, joint: 0.3)
    rows, model = select_rows(measured, (0,)), Model(measured)
    (option,) = options_beside(model, rows, evaluate(model, rows), [payload])
    assert option.theta["distance"] == 2.0 and option.gain > 0.0


def test_refining_stays_within_what_an_effect_can_be(recording: Recording) -> None:
    """Friction that gives way over millirads is no hysteresis, however well that fits."""
    candidate = Candidate(effect=BY_NAME["hysteresis"], joint=ELBOW)
    joint = unfitted(recording, ELBOW)
    effort = recording.inverse.copy()
    effort[:, ELBOW] += joint.wound(0.004 * joint.travel[1])
    measured = replace(recording, effort=recording.filtered(effort), cache={})
    rows, model = select_rows(measured, (0,)), Model(measured)
    estimate = unfitted(measured, ELBOW).estimate
    option = _try(model, rows, candidate, estimate, evaluate(model, rows))
    assert option is not None
    better, scored = refined(option, rows)
    found = dict(enumerate(scored.coefficients))
    assert candidate.effect.beyond(joint, better.terms[-1].theta, found) == ""


@pytest.mark.parametrize("hertz", [2.0, 9.0])
def test_a_lag_is_what_it_is_near_the_cutoff_too(recording: Recording, hertz: float) -> None:
    """A stranger's of 24 ms was 27: the law's slope passed the fit's low-pass twice."""
    swing = 0.8 * np.sin(2 * np.pi * hertz * recording.time)
    known = np.array(recording.inverse)
    known[:, ELBOW] += swing
    effort = known + LAG * recording.derivative(known)
    late = replace(recording, effort=recording.filtered(effort), cache={})
    model = Model(late, terms=(Term(joint=ELBOW, columns={ELBOW: swing[:, None]}, kept=(0,)),))
    rows, candidate = (
        select_rows(late, (0,)),
        Candidate(effect=BY_NAME["actuator_lag"], joint=ELBOW),
    )
    found = tried_alone(model, rows, candidate)
    assert found is not None
    assert found[0].channels[-1].theta["time_constant"] == pytest.approx(LAG, rel=0.01)


def test_a_drift_levels_off_when_it_does_not_when_the_grid_has_it(recording: Recording) -> None:
    """What a wrong time constant leaves goes with time, and some of it is called stiffness."""
    effort = recording.inverse.copy()
    effort[:, ELBOW] += 3.0 * (1.0 - np.exp(-recording.time / (0.37 * np.ptp(recording.time))))
    measured = replace(recording, joints=(ELBOW,), effort=recording.filtered(effort), cache={})
    rows, model = select_rows(measured, (0,)), Model(measured)
    found = tried_alone(model, rows, Candidate(effect=BY_NAME["drift"], joint=ELBOW))
    assert found is not None
    assert found[0].terms[-1].theta["level_off"] == pytest.approx(0.37, rel=0.1)


def test_no_effect_loses_to_another_by_the_grain_of_its_grid(recording: Recording) -> None:
    """A hardening spring's centre lies between the grid's; a wave over the angle is near it."""
    noise, joint = 0.05, unfitted(recording, ELBOW)
    middle, half = joint.travel
    effort = recording.inverse + noise * np.random.default_rng(3).standard_normal((1000, 2))
    effort[:, ELBOW] += 60.0 * (joint.position - middle - 0.06 * half) ** 3
    loud = replace(recording, joints=(ELBOW,), effort=recording.filtered(effort), cache={})
    rows = select_rows(loud, (0,)).reweighted({ELBOW: noise})
    tried = [
        Candidate(effect=BY_NAME[name], joint=ELBOW)
        for name in ("nonlinear_stiffness", "torque_ripple")
    ]
    model = Model(loud)
    best = options_beside(model, rows, evaluate(model, rows), tried)[0]
    assert best.candidate.effect.name == "nonlinear_stiffness"
    assert best.theta["centre"] == pytest.approx(middle + 0.06 * half, abs=0.02 * half)
    assert best.score.loss < 1.5 * len(rows.weight)


@pytest.mark.parametrize(("joint", "other"), [(0, 2), (2, 0), (1, 2), (1, 0)])
def test_a_coupling_is_found_to_whichever_joint_it_is(joint: int, other: int) -> None:
    """A tendon may pass over the joint between."""
    moving = swung(CHAIN, (0.2, 0.4, -0.3), (0.7, 0.4, 0.55))
    effort = np.array(moving.inverse)
    effort[:, joint] += 2.0 * moving.position[:, other] + 0.1 * moving.velocity[:, other]
    measured = replace(moving, effort=moving.filtered(effort), cache={})
    rows, model = select_rows(measured, (0,)), Model(measured)
    coupling = Candidate(effect=BY_NAME["cross_joint_coupling"], joint=joint)
    (option,) = options_beside(model, rows, evaluate(model, rows), [coupling])
    assert option.theta["other_dof"] == other
    assert option.gain > 0.99 * evaluate(model, rows).loss
