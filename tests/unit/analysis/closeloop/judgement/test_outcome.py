"""What makes a residual more than noise."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.accuracy import settled
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import (
    Errors,
    Event,
    Floor,
    Outcome,
    Structure,
    Trace,
)
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.identification.tracing import trace
from analysis.closeloop.judgement import outcome as outcomes
from analysis.closeloop.judgement.outcome import (
    _above,
    _large,
    _unsettled,
    left_beside_events,
    left_in_band,
    takes_too_little,
    verdict_of,
    worse_than_none,
)
from analysis.closeloop.report.json_report import advice
from analysis.closeloop.report.unexplained import not_settled
from analysis.closeloop.session.contents import DeclaredEffect, Trial
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.coupled import NOISE, measured, moving


@pytest.mark.parametrize(("size", "left"), [(0.03, False), (0.08, True)])
def test_an_oscillation_counts_only_next_to_the_floor(size: float, left: bool) -> None:
    outcome = SimpleNamespace(
        left={},
        unsettled=(),
        structures={},
        by_trial={},
        events=(),
        loads=(),
        floors={0: Floor(value=0.1, source="above the band")},
        oscillations={0: [Peak(low_hz=90.0, high_hz=110.0, rms=size)]},
    )
    assert left_beside_events(cast(Outcome, outcome)) is left
    assert left_beside_events(cast(Outcome, SimpleNamespace(**{**vars(outcome), "floors": {}})))


@pytest.mark.parametrize(("smoothing", "kept"), [(0.02, True), (0.2, False)])
def test_what_goes_with_a_signal_counts_if_smoothing_does_not_make_it(
    smoothing: float, kept: bool
) -> None:
    """A structure of a thousandth of the effort: less than backlash leaves on a good robot."""
    count = 100
    rows = SimpleNamespace(
        samples={0: np.arange(count)},
        parts={0: slice(0, count)},
        weight=np.full(count, 0.5),
        effort_power=lambda joint: count * (0.5 * 50.0) ** 2,
        smoothing_power=lambda joint: count * (0.5 * smoothing) ** 2,
    )
    found = {0: [Structure(signal="effort", rms=0.05, p_value=1e-9)]}
    floors = {0: Floor(value=0.1, source="repeats")}
    trace = cast(Trace, SimpleNamespace(rows=rows))
    assert bool(_large(trace, found, floors)[0]) is kept


@pytest.mark.parametrize("beside", [False, True])
def test_after_a_push_alone_the_advice_is_to_repeat_the_trial_untouched(
    recording: Recording, beside: bool
) -> None:
    """Who was pushed was told to record EMG."""
    outcome = SimpleNamespace(
        trace=SimpleNamespace(
            verdict=Verdict.ADEQUATE, steps=(), rows=select_rows(recording, (0,))
        ),
        verdict=Verdict.UNEXPLAINED,
        events=(Event(trial=0, joint=0, begin=1.0, end=1.5, peak=-0.4),),
        structures={0: [1] if beside else []},
        by_trial={},
        left={},
        unsettled=(),
        loads=(),
        floors={},
        oscillations={},
    )
    first, *more = advice(cast(Outcome, outcome))
    assert f"Repeat {recording.session.trials[0].file}" in first
    assert [("EMG" in line) for line in more] == [True] * beside


def test_a_push_is_said_whatever_else_the_trials_cannot_tell() -> None:
    """Held, a joint moved one way only, by the push: `not_identifiable` hid the event."""
    event = Event(trial=0, joint=0, begin=1.0, end=1.5, peak=-0.4)
    trace = SimpleNamespace(verdict=Verdict.NOT_IDENTIFIABLE, steps=())
    quiet = cast(Outcome, SimpleNamespace(trace=trace, events=()))
    pushed = cast(Outcome, SimpleNamespace(trace=trace, events=(event,)))
    assert verdict_of(quiet) == Verdict.NOT_IDENTIFIABLE
    assert verdict_of(pushed) == Verdict.UNEXPLAINED
    named = cast(
        Outcome,
        SimpleNamespace(
            trace=SimpleNamespace(verdict=Verdict.NOT_IDENTIFIABLE, steps=(1,)), events=(event,)
        ),
    )
    assert verdict_of(named) == Verdict.NOT_IDENTIFIABLE


def rubbing(beyond: float) -> Recording:
    """Return a robot whose first joint creeps in the trial that is fitted and runs in the other.

    Args:
        beyond: what the quick trial adds to the friction that is declared, Nm.
    """
    whole = moving()
    quick = np.arange(len(whole.time)) >= len(whole.time) // 2
    turns = np.sign(whole.velocity[:, 0])
    wave = np.sin(np.arange(len(turns)) / 20.0)
    speed = turns * np.where(quick, 1.0 + 0.3 * wave, 0.1 + 0.0002 * wave)
    trials = tuple(
        Trial(file=f"{role}.csv", label=role, group=role, role=role) for role in ("fit", "holdout")
    )
    friction = tuple(
        DeclaredEffect(effect=name, joint=whole.name(0))
        for name in ("coulomb_friction", "viscous_friction")
    )
    half = int(quick.argmax())
    robot = replace(
        whole,
        session=replace(whole.session, trials=trials, declared=friction),
        slices=[slice(0, half), slice(half, len(quick))],
        trial=quick.astype(int),
        velocity=np.column_stack([speed, whole.velocity[:, 1:]]),
        fit_trials=(0,),
        cache={},
    )
    effort = np.array(robot.inverse)
    effort[:, 0] += 0.3 * turns + 0.5 * speed + beyond * quick * wave
    return measured(robot, effort)


def judged(recording: Recording) -> Outcome:
    """Return what a session with a floor at its noise comes to, before its verdict."""
    found = trace(recording)
    assert found.verdict == Verdict.ADEQUATE
    nothing = Errors(before=[], after=[])
    outcome = Outcome(
        trace=found,
        verdict=found.verdict,
        fit=nothing,
        holdout=nothing,
        left_out=False,
        oscillations={},
        floors={joint: Floor(value=NOISE, source="declared") for joint in recording.joints},
        structures={},
        by_trial={},
        events=(),
        loads=(),
        hidden={},
        left=left_in_band(recording, settled(*found.fits[1]), rubs=True),
        unsettled=(),
    )
    assert left_beside_events(outcome)
    return replace(outcome, unsettled=_unsettled(outcome, rubs=True))


def test_friction_that_one_speed_does_not_determine_is_said_to_be_so() -> None:
    """A clean arm was `unexplained`: viscosity of one slow trial was far off in the quick one."""
    outcome = judged(rubbing(0.0))
    assert outcome.unsettled == (0,)
    assert verdict_of(outcome) == Verdict.NOT_IDENTIFIABLE
    (line,) = not_settled(outcome)
    assert "a: the fit trials" in line and "(coulomb_friction, viscous_friction)" in line


def test_a_joint_that_only_held_out_trials_move_is_weighed_by_what_those_leave() -> None:
    """A pushed arm of six joints had no report."""
    outcome = judged(rubbing(0.0))
    known = outcome.trace.explainable_before
    of_first = replace(known, noise={0: known.noise[0]})
    trace_of_one = replace(outcome.trace, explainable_before=of_first)
    assert _unsettled(replace(outcome, trace=trace_of_one), rubs=True) == (0,)


def test_what_no_declared_friction_explains_in_the_quick_trial_stays_unexplained() -> None:
    outcome = judged(rubbing(0.05))
    assert outcome.unsettled == ()
    assert verdict_of(outcome) == Verdict.UNEXPLAINED


@pytest.mark.parametrize(("error", "told"), [(2.0, True), (1.1, False)])
def test_what_predicts_worse_than_no_torque_is_told(error: float, told: bool) -> None:
    """A trial in degrees was `adequate` at twice the effort; noise alone is as large as itself."""
    effort = np.random.default_rng(7).standard_normal(500)
    left = TrialError(
        trial=0, joint=0, time=np.arange(500.0), effort=effort, predicted=effort - error * effort
    )
    outcome = SimpleNamespace(holdout=Errors(before=[left], after=[left]))
    assert bool(worse_than_none(cast(Outcome, outcome))) is told


@pytest.mark.parametrize(
    ("names", "without", "over", "told"),
    [
        (("time_delay", "added_inertia"), 1.5, 9.0, True),
        (("time_delay", "added_inertia"), 3.0, 9.0, False),
        (("time_delay", "added_inertia"), 1.5, 1.5, False),
        (("time_delay", "coulomb_friction"), 1.5, 9.0, False),
        ((), 1.5, 9.0, False),
    ],
    ids=["a little", "most", "all but noise", "friction, too", "nothing"],
)
def test_what_a_controller_answers_is_no_cause_where_it_takes_a_little(
    names: tuple[str, ...],
    without: float,
    over: float,
    told: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Cable jerks were a delay of 22 ms, what a limb did of itself one beside inertia."""
    monkeypatch.setattr(outcomes, "evaluate", lambda *_: SimpleNamespace(loss=without))
    steps = [
        SimpleNamespace(taken=SimpleNamespace(candidate=Candidate(effect=BY_NAME[name], joint=0)))
        for name in names
    ]
    rows = SimpleNamespace(recording=SimpleNamespace(limbs=(0,)))
    score = SimpleNamespace(loss=1.0)
    found = SimpleNamespace(
        verdict=Verdict.EFFECT_FOUND, steps=steps, declared=None, score=score, rows=rows
    )
    outcome = SimpleNamespace(trace=found, left={0: 1.0}, over_floor=lambda _: over)
    said = takes_too_little(cast(Outcome, outcome))
    assert ("came nearest, but left most" in said) is told and bool(said) is told


def test_what_is_weaker_than_the_noise_of_its_channel_is_no_event() -> None:
    strong, weak, other = (
        Event(trial=0, joint=joint, begin=1.0, end=1.2, peak=peak)
        for joint, peak in ((1, -0.06), (1, 0.02), (0, 0.02))
    )
    lowest = {1: Floor(value=0.025, source="repeats")}
    assert _above(lowest, (strong, weak, other)) == (strong, other), "the other has no floor"
