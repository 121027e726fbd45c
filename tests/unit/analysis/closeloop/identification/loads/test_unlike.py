"""A held-out trial that carries something else than the fitted ones is told without fitting it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import last_links
from analysis.closeloop.identification.loads.carried import supposing_loads
from analysis.closeloop.identification.loads.unlike import supposing_held_out
from analysis.closeloop.session.recording import Recording
from sim.effects.rigid import point_mass
from tests.testbed.sessions.coupled import in_trials, measured

MASS, AT = 0.4, (0.1, 0.0, 0.05)
#: The last trial is held out.
TRIALS, HELD = 4, 3


def carrying(*mass: float) -> Recording:
    """Return trials of a robot that rubs and carries a mass in each, kg."""
    arm = in_trials(np.ones((TRIALS, 3), dtype=bool))
    effort = arm.rigid + 0.3 * np.sign(arm.velocity) + 0.2 * arm.velocity
    (body,) = last_links(arm)
    each = np.array(mass)[arm.trial][:, None]
    effort = effort + each * (arm.link_torque(body) @ point_mass(np.array(AT)))
    trials = list(arm.session.trials)
    trials[HELD] = replace(trials[HELD], role="holdout")
    session = replace(arm.session, trials=tuple(trials))
    arm = replace(arm, session=session, fit_trials=tuple(range(HELD)))
    return measured(arm, effort, noise=0.02)


def supposed(recording: Recording) -> list[list[int]]:
    """Return the numbers of the trials that seem to carry each load."""
    trials = supposing_held_out(supposing_loads(recording)).session.trials
    loads = list(dict.fromkeys(trial.payload for trial in trials if trial.payload is not None))
    return [[n for n, trial in enumerate(trials) if trial.payload == load] for load in loads]


@pytest.mark.parametrize(
    ("mass", "found"),
    [
        ((0.0, 0.0, 0.0, 0.0), []),
        # What every trial carries is the robot's own, until one is without.
        ((MASS, MASS, MASS, MASS), []),
        ((MASS, MASS, MASS, 0.0), [[0, 1, 2]]),
        ((0.0, MASS, 0.0, MASS), [[1, 3]]),
        ((0.0, MASS, 0.0, 0.0), [[1]]),
        # With another load than any fitted trial's it is asked for once all is traced.
        ((0.0, 0.0, 0.0, MASS), []),
    ],
)
def test_a_held_out_trial_carries_what_fitted_ones_do_or_nothing(
    mass: tuple[float, ...], found: list[list[int]]
) -> None:
    assert supposed(carrying(*mass)) == found


def test_friction_that_is_larger_in_a_held_out_trial_is_no_load() -> None:
    arm = carrying(MASS, MASS, MASS, MASS)
    more = np.where(arm.trial == HELD, 1.0, 0.0)[:, None] * np.sign(arm.velocity)
    assert supposed(measured(arm, arm.unfiltered + more)) == []


def test_a_load_that_the_session_names_is_not_asked_for() -> None:
    arm = supposing_held_out(carrying(MASS, MASS, MASS, 0.0))
    (load,) = {trial.payload for trial in arm.session.trials if trial.payload is not None}
    trials = tuple(replace(t, payload=replace(load, supposed=0.0)) for t in arm.session.trials)
    named = replace(arm, session=replace(arm.session, trials=trials), cache={})
    assert supposing_held_out(named) is named
