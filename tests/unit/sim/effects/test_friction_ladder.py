"""The ladder of load-dependent friction, after Duclusaud et al. 2025 (github Rhoban/bam)."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import candidates, options_beside
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import REST_SHARE
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Law
from tests.testbed.sessions.rich import ELBOW, TRUTH, torque

RUNGS = ("directional_load_friction", "quadratic_load_friction", "stribeck_load_friction")


@pytest.mark.parametrize(("hold", "speed"), [(4.0, 0.3), (4.0, -0.3), (-2.5, 0.3), (-2.5, -0.3)])
def test_the_directional_rung_is_the_law_of_motor_and_external_torque(
    hold: float, speed: float
) -> None:
    """At constant speed, |mu_e tau_e - mu_m tau_m| of the paper, its own torque included."""
    base, external, motor = 0.2, 0.03, 0.12
    sign, moved = np.sign(speed), hold
    for _ in range(200):
        friction = base + abs(external * hold + motor * moved)
        moved = hold + friction * sign
    law = BY_NAME["directional_load_friction"]
    assert isinstance(law, Law)
    joint = _Motion(hold, speed)
    both = external + motor
    found = law.level(  # type: ignore[attr-defined]
        {
            "torque": base / (1.0 - motor * sign * np.sign(hold)),
            "driving_share": both / (1.0 - motor),
            "driven_share": both / (1.0 + motor),
        },
        joint,
    )
    assert float(found) == pytest.approx(friction, rel=1e-6)


class _Motion:
    def __init__(self, load: float, velocity: float) -> None:
        self.load, self.velocity = load, velocity


def test_a_rung_is_asked_for_only_above_a_simpler_one(recording: Recording) -> None:
    needed = torque(recording, "quadratic_load_friction")
    noise = 0.01 * np.random.default_rng(4).standard_normal(needed.shape)
    effort = recording.filtered(recording.inverse + needed + noise)
    own = replace(recording, joints=(ELBOW,), effort=effort)
    rows = select_rows(own, own.fit_trials)
    bare = Model(own)
    first = options_beside(bare, rows, evaluate(bare, rows), candidates(own))
    names = {option.candidate.effect.name for option in first}
    assert "load_dependent_friction" in names and not names & set(RUNGS)
    simple = next(o for o in first if o.candidate.effect.name == "load_dependent_friction")
    second = options_beside(simple.model, rows, evaluate(simple.model, rows), candidates(own))
    rungs = [o for o in second if o.candidate.effect.name in RUNGS]
    assert {o.candidate.effect.name for o in rungs} == set(RUNGS)
    # It takes the place of the simpler one, and does not stand beside it.
    assert all(("load_dependent_friction", ELBOW) in option.replaced for option in rungs)
    best = max(rungs, key=lambda option: option.gain)
    assert best.candidate.effect.name == "quadratic_load_friction"


@pytest.mark.parametrize("name", RUNGS)
def test_no_rung_takes_more_than_half_of_the_load(name: str, recording: Recording) -> None:
    theta, found = TRUTH[name]
    greedy = dict(enumerate(found)) | {1: 0.7}
    wrong = BY_NAME[name].beyond(unfitted(recording, ELBOW), theta, greedy)
    assert wrong in ("load_share", "driving_share")


def test_a_stribeck_speed_is_looked_for_wherever_a_joint_slides(recording: Recording) -> None:
    """Begun within two thirds of an octave, from where it rests: a quick arm loses it at 1 %."""
    stribeck = BY_NAME["stribeck_friction"]
    begun = {theta["speed"] for theta in stribeck.thetas(unfitted(recording, ELBOW))}
    for speed in np.geomspace(REST_SHARE, 0.4, 30):
        assert min(abs(np.log2(speed / own)) for own in begun) < 2 / 3


def test_whose_torque_friction_goes_with_is_a_part_of_stiffness(recording: Recording) -> None:
    """Of a fifth of the motor's torque K was 4 % too high, by the joint's, and sure of it."""
    law, torque_alone, share = BY_NAME["load_dependent_friction"], 0.1, 0.2
    effort = np.array(recording.effort)
    effort[:, ELBOW] = np.linspace(-3.0, 3.0, len(effort))
    joint = unfitted(replace(recording, effort=effort, cache={}), ELBOW)
    sizes = np.array([torque_alone, share])
    further = law.unsaid(joint, {"smooth": 0.02, "load": 1}, sizes)[ELBOW][:, 0]
    motor = effort[:, ELBOW]
    for direction in (-1.0, 1.0):
        of_motor = (torque_alone + share * np.abs(motor)) * direction
        of_joint = (torque_alone + share * np.abs(motor - of_motor)) * direction
        carries = np.abs(motor) > 0.5
        assert (of_motor - of_joint)[carries] == pytest.approx(further[carries], abs=1e-12)
    assert law.unsaid(joint, {"smooth": 0.02, "load": 1}, sizes[:1]) == {}
