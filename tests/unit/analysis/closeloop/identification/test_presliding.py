"""Friction that winds up over some millirads is that friction, and no hysteresis beside it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.luck import MIN_GAIN
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.presliding import only_presliding
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.motion import PRESLIDING_SHARE
from tests.testbed.sessions.rich import ELBOW, rich_elbow


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow()


def named(elbow: Recording, way: float, friction: float, *, alone: bool = False) -> bool:
    """Whether hysteresis passes beside Coulomb friction; it is there over a way, 1 Nm.

    Args:
        elbow: without friction.
        way: over half the travel.
        friction: that slides at once, Nm.
        alone: whether it is the first effect instead.
    """
    joint = unfitted(elbow, ELBOW)
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += joint.wound(way * joint.travel[1]) + friction * np.sign(joint.velocity)
    effort[:, ELBOW] += 0.02 * np.random.default_rng(3).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    thetas = {
        "coulomb_friction": {"smooth": 0.004},
        "hysteresis": {"distance": max(way, 1.2 * PRESLIDING_SHARE), "exponent": 1.0},
    }
    terms = [
        Term(
            joint=ELBOW,
            columns=BY_NAME[name].columns(unfitted(loud, ELBOW), theta),
            kept=(0,),
            theta=theta,
            effect=BY_NAME[name],
            candidate=Candidate(effect=BY_NAME[name], joint=ELBOW),
        )
        for name, theta in thetas.items()
    ]
    model = Model(loud, terms=() if alone else (terms[0],))
    candidate = terms[1].candidate
    assert candidate is not None
    beside = model.with_term(terms[1])
    return not only_presliding(candidate, beside, model, select_rows(loud, (0,)))


def test_friction_that_winds_up_over_presliding_s_way_is_no_hysteresis(elbow: Recording) -> None:
    assert not named(elbow, 0.7 * PRESLIDING_SHARE, 0.0)


def test_what_winds_up_over_a_longer_way_is_hysteresis_beside_friction(elbow: Recording) -> None:
    assert named(elbow, 0.15, 1.0)


@pytest.mark.parametrize(("way", "hysteresis"), [(0.3 * PRESLIDING_SHARE, False), (0.1, True)])
def test_a_first_effect_that_winds_up_is_judged_beside_friction_that_does(
    elbow: Recording, way: float, hysteresis: bool
) -> None:
    """Friction that turns at once is no rival: hysteresis of the shortest way is nearer."""
    assert named(elbow, way, 0.0, alone=True) is hysteresis


def stribeck_beside_friction(elbow: Recording, effort: np.ndarray, smooth: float) -> bool:
    """Whether Stribeck friction passes beside Coulomb friction that turns over some speed.

    Args:
        elbow: without friction.
        effort: of the friction there, Nm.
        smooth: speed over which both turn, over the highest.
    """
    torque = np.array(elbow.inverse)
    torque[:, ELBOW] += effort + 0.02 * np.random.default_rng(3).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(torque), cache={})
    rows, model = select_rows(loud, (0,)), Model(loud)
    effect = BY_NAME["coulomb_friction"]
    candidate = Candidate(effect=BY_NAME["stribeck_friction"], joint=ELBOW)
    joint, theta = unfitted(loud, ELBOW), {"smooth": smooth}
    columns = effect.columns(joint, theta)
    model = model.with_term(
        Term(joint=ELBOW, columns=columns, kept=(0,), theta=theta, effect=effect)
    )
    found = []
    for speed in (0.07, 0.12, 0.24):
        theta = {"smooth": smooth, "speed": speed, "power": 2.0}
        columns = candidate.effect.columns(joint, theta)
        term = Term(joint=ELBOW, columns=columns, kept=(1,), theta=theta, effect=candidate.effect)
        found.append(model.with_term(replace(term, candidate=candidate)))
    beside = min(found, key=lambda one: evaluate(one, rows).loss)
    alone = evaluate(model, rows).loss
    assert evaluate(beside, rows).loss < 0.9 * alone
    return not only_presliding(candidate, beside, model, rows, MIN_GAIN * alone)


def test_friction_that_winds_up_is_no_stribeck_friction_beside_one_that_turns_late(
    elbow: Recording,
) -> None:
    """Fitted with a speed to turn over, it lacks something between that speed and rest."""
    joint = unfitted(elbow, ELBOW)
    wound = joint.wound(0.3 * PRESLIDING_SHARE * joint.travel[1])
    assert not stribeck_beside_friction(elbow, wound, 0.05)


def test_friction_that_falls_with_speed_is_stribeck_friction(elbow: Recording) -> None:
    joint = unfitted(elbow, ELBOW)
    speed = joint.velocity / joint.top_speed
    falling = (0.6 + 0.9 * np.exp(-((speed / 0.24) ** 2))) * np.sign(speed)
    assert stribeck_beside_friction(elbow, falling, 0.004)
