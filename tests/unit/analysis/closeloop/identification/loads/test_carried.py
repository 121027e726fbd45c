"""A trial that carries what the others do not is found before friction and links take it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import last_links
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.balance import declared
from analysis.closeloop.identification.balance.declared import hung_again, load_about
from analysis.closeloop.identification.balance.model import Model, with_independent
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.loads.carried import supposing_loads
from analysis.closeloop.session.recording import Recording
from sim.effects.rigid import point_mass
from tests.testbed.sessions.coupled import in_trials, measured

MASS, AT = 0.4, (0.1, 0.0, 0.05)
TRIALS = 4


def carrying(mass: dict[int, float]) -> Recording:
    """Return trials of a robot that rubs and carries in some of them, by their numbers, kg."""
    arm = in_trials(np.ones((TRIALS, 3), dtype=bool))
    effort = arm.rigid + 0.3 * np.sign(arm.velocity) + 0.2 * arm.velocity
    (body,) = last_links(arm)
    each = np.array([mass.get(number, 0.0) for number in range(TRIALS)])[arm.trial]
    effort = effort + each[:, None] * (arm.link_torque(body) @ point_mass(np.array(AT)))
    return measured(arm, effort, noise=0.02)


def supposed(recording: Recording) -> list[list[int]]:
    """Return the numbers of the trials that seem to carry each load."""
    trials = supposing_loads(recording).session.trials
    loads = list(dict.fromkeys(trial.payload for trial in trials if trial.payload is not None))
    return [[n for n, trial in enumerate(trials) if trial.payload == load] for load in loads]


@pytest.mark.parametrize(
    ("mass", "found"),
    [
        ({}, []),
        ({2: MASS}, [[2]]),
        ({1: MASS, 3: MASS}, [[1, 3]]),
        # Most trials may carry it: those without tell it all the same.
        ({0: MASS, 1: MASS, 3: MASS}, [[0, 1, 3]]),
        ({1: MASS, 3: 2 * MASS}, [[1], [3]]),
        # What every trial carries is the robot's own.
        (dict.fromkeys(range(TRIALS), MASS), []),
    ],
)
def test_trials_with_one_load_are_told_from_those_without(
    mass: dict[int, float], found: list[list[int]]
) -> None:
    assert sorted(supposed(carrying(mass))) == found


def test_friction_that_is_larger_in_one_trial_is_no_load() -> None:
    arm = carrying({})
    more = np.where(arm.trial == 2, 1.0, 0.0)[:, None] * np.sign(arm.velocity)
    assert supposed(measured(arm, arm.unfiltered + more)) == []


def test_a_limb_is_not_asked_for_loads() -> None:
    arm = carrying({2: MASS})
    limb = replace(arm, session=replace(arm.session, limb_joints=("b",)), cache={})
    assert limb.limbs and supposed(limb) == []


def test_of_several_loads_each_hangs_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first was hung anew, and the second beside itself, which was on its way."""
    monkeypatch.setattr(declared, "PLACE_STEPS", 1)
    arm = supposing_loads(carrying({1: MASS, 3: 2 * MASS}))
    rows = select_rows(arm, arm.fit_trials)
    model = with_ordinary(Model(arm), rows)
    for load in {trial.payload: None for trial in arm.session.trials if trial.payload}:
        # Not where it hangs.
        model = with_independent(model, load_about(arm, load, np.array([0.0, 0.3, -0.3])), rows)
    loads = [term.load for term in hung_again(model, rows).terms if term.load is not None]
    assert len(loads) == len(set(loads)) == 2
