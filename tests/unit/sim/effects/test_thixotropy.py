"""A limb that resists more after a rest than while it moves."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import candidates, options_beside
from sim.effects.laws.limb import Structure
from tests.testbed.sessions.rests import RATE, with_rests
from tests.testbed.sessions.rich import ELBOW


def short_range(position: np.ndarray, moving: float) -> np.ndarray:
    """A spring over 0.03 rad that then yields; 2 Nm after a rest, of which `moving` stays."""
    anchor, strength, torque = position[0], 1.0, []
    for before, now in pairwise(position):
        lost = (strength - moving) * abs(now - before) / 0.15
        strength += (1.0 - strength) / 1.5 / RATE - lost
        anchor = min(max(anchor, now - 0.03), now + 0.03)
        torque.append(2.0 * strength * (now - anchor) / 0.03)
    return np.array([0.0, *torque])


@pytest.mark.parametrize(
    ("moving", "name"),
    [(0.2, "thixotropy"), (1.0, "hysteresis")],
    ids=["lost by moving", "never lost"],
)
def test_rests_tell_thixotropy_from_hysteresis(moving: float, name: str) -> None:
    still = with_rests()
    q, v = still.position[:, ELBOW], still.velocity[:, ELBOW]
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 10.0 * (q - 0.9) + 0.5 * v + short_range(q, moving)
    effort += 0.02 * np.random.default_rng(3).standard_normal(effort.shape)
    loud = replace(still, effort=still.filtered(effort), cache={})
    rows = select_rows(loud, (0,))
    model = declared_model(loud, rows)
    wanted = [c for c in candidates(loud) if c.effect.name in ("thixotropy", "hysteresis")]
    best, other = options_beside(model, rows, evaluate(model, rows), wanted)
    if name == "thixotropy":
        assert best.candidate.effect.name == name
        assert other.score.loss > 5.0 * best.score.loss
        assert best.score.coefficients[0] == pytest.approx(10.0, rel=0.02)
    else:
        # The richer one holds the simpler, and gains nothing beyond it.
        assert best.score.loss > 0.8 * other.score.loss


@pytest.mark.parametrize(("recovery", "distance"), [(2.0, 0.3), (0.01, 0.001)])
def test_a_recorded_trial_has_the_structure_that_a_simulation_steps_through(
    recovery: float, distance: float
) -> None:
    """Also where steps over the trial divide by more than a number can hold."""
    whole = with_rests()
    structure, state, stepped = Structure(recovery=recovery, distance=distance), 1.0, []
    for speed in np.abs(whole.velocity[:, ELBOW]):
        stepped.append(state)
        state = structure.stepped(state, 1.0 / RATE, speed * (1.0 / RATE))
    assert structure.along(unfitted(whole, ELBOW)) == pytest.approx(np.array(stepped), rel=1e-10)


def test_a_spring_that_yields_is_stretched_as_step_after_step_makes_it() -> None:
    rng = np.random.default_rng(3)
    whole = with_rests()
    places = np.array(whole.position)
    # Reversals at nearly every sample, then rests among long ways.
    places[:, ELBOW] = np.where(
        np.arange(len(places)) % 50 < 25, rng.normal(size=len(places)), places[:, ELBOW]
    )
    shaken = replace(whole, position=places, cache={})
    state, expected = 0.0, []
    for way in np.diff(places[:, ELBOW], prepend=places[0, ELBOW]) / 0.4:
        state = min(max(state + way, -1.0), 1.0)
        expected.append(state)
    found = unfitted(shaken, ELBOW).wound(0.4, exponent=0.0)
    assert found == pytest.approx(np.array(expected), abs=1e-12)


def test_lost_samples_are_no_rest() -> None:
    whole = with_rests()
    structure = Structure(recovery=2.0, distance=0.3)
    middle = len(whole.time) // 2
    middle += int(np.argmax(np.abs(whole.velocity[middle:, ELBOW])))
    torn = replace(whole, slices=[slice(0, middle), slice(middle + 5, len(whole.time))], cache={})
    left = structure.along(unfitted(whole, ELBOW))
    assert left[middle] < 0.6
    assert structure.along(unfitted(torn, ELBOW))[middle + 5 :] == pytest.approx(
        left[middle + 5 :], abs=0.02
    )
    other = np.where(np.arange(len(whole.time)) < middle, 0, 1)
    again = structure.along(unfitted(replace(torn, trial=other), ELBOW))
    assert again[middle + 5] == 1.0
