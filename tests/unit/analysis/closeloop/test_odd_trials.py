"""A trial in another unit than the others, or with columns exchanged, is one error."""

import re
from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.odd_trials import check_odd_trials
from analysis.closeloop.remedies import scaled, with_efforts_exchanged, with_motions_exchanged
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rubbing import rubbing_robot

TRIALS = 4


@pytest.fixture(scope="module")
def robot() -> Recording:
    """Four trials, the last of them held out."""
    robot = rubbing_robot()
    (only,) = robot.session.trials
    trials = [replace(only, file=f"t{n}.csv", label=f"run {n}") for n in range(TRIALS)]
    trials[-1] = replace(trials[-1], role="holdout")
    number = np.minimum(np.arange(len(robot.time)) * TRIALS // len(robot.time), TRIALS - 1)
    session = replace(robot.session, trials=tuple(trials))
    fitted = tuple(range(TRIALS - 1))
    return replace(robot, session=session, trial=number, fit_trials=fitted, cache={})


def refused(robot: Recording) -> SessionError:
    with pytest.raises(SessionError) as caught:
        check_odd_trials(robot)
    return caught.value


def with_effort_times(robot: Recording, trial: int, factors: list[float]) -> Recording:
    times = np.where((robot.trial == trial)[:, None], factors, 1.0)
    return replace(robot, effort=robot.effort * times, cache={})


def test_trials_that_agree_are_no_error(robot: Recording) -> None:
    check_odd_trials(robot)


@pytest.mark.parametrize("trial", [0, 2, 3])
@pytest.mark.parametrize(
    ("times", "said"),
    [
        (1000.0, "[0-9.]* times what the other trials predict of elbow: is its unit mNm there"),
        (0.001, "1/[0-9.]* of what .* of elbow: is its unit mNm in the others"),
        (57.3, "[0-9.]* times .* of elbow: what is its unit there"),
    ],
)
def test_an_effort_in_another_unit_in_one_trial_is_an_error(
    robot: Recording, trial: int, times: float, said: str
) -> None:
    error = refused(with_effort_times(robot, trial, [1.0, times]))
    assert (error.file, error.column) == (f"t{trial}.csv", "elbow.effort")
    assert f"is in run {trial}" in str(error)
    assert re.search(said, str(error))


def test_efforts_that_a_gain_or_a_load_can_explain_are_no_error(robot: Recording) -> None:
    check_odd_trials(with_effort_times(robot, 1, [1.0, 3.0]))
    check_odd_trials(with_effort_times(robot, 1, [0.1, 10.0]))


@pytest.mark.parametrize(("times", "unit"), [(57.29578, "degrees"), (0.5 / np.pi, "turns")])
def test_a_position_in_another_unit_in_one_trial_is_an_error(
    robot: Recording, times: float, unit: str
) -> None:
    factors = np.where((robot.trial == 1)[:, None], [1.0, times], 1.0)
    error = refused(scaled(robot, factors))
    assert (error.file, error.column) == ("t1.csv", "elbow.position")
    assert f"looks like {unit} in run 1" in str(error)


@pytest.mark.parametrize("trial", [1, 3])
def test_columns_that_are_exchanged_in_one_trial_are_an_error(robot: Recording, trial: int) -> None:
    rows = robot.trial == trial
    error = refused(with_efforts_exchanged(robot, (0, 1), rows))
    assert (error.file, error.column) == (f"t{trial}.csv", "shoulder.effort")
    assert f"looks exchanged with that of elbow in run {trial}" in str(error)
    error = refused(with_motions_exchanged(robot, (0, 1), rows))
    assert (error.file, error.column) == (f"t{trial}.csv", "shoulder.position")


def test_of_two_trials_that_disagree_the_one_far_from_the_model_is_named(robot: Recording) -> None:
    two = replace(robot, fit_trials=(0, 1), trial=np.minimum(robot.trial, 1), cache={})
    for trial in (0, 1):
        assert refused(with_effort_times(two, trial, [1.0, 1000.0])).file == f"t{trial}.csv"


def test_a_trial_that_the_others_do_not_predict_is_no_other_unit(robot: Recording) -> None:
    pushed = robot.effort + np.where((robot.trial == 1)[:, None], [0.0, 60.0], 0.0) * np.sin(
        9.0 * robot.time[:, None]
    )
    check_odd_trials(replace(robot, effort=pushed, cache={}))
