"""Every set of steps is looked at, and each as if it were the only one."""

import numpy as np
import pytest

from analysis.interpretation import answer, plan
from analysis.interpretation.answer import Question, interpret
from analysis.interpretation.every_plan import every_plan
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.view import View
from analysis.interpretation.plan import Step, half_width_after, shortest_plan, steps
from analysis.interpretation.recording import Recording
from sim.assessment.summary import Motion
from tests.testbed.bank import bank, samples

#: One that both can be measured better than, one that length cannot, and one that stays.
KNOWN = (
    (),
    (Known(name="forearm_length", value=0.3, sd=0.006),),
    (
        Known(name="forearm_length", value=0.3, sd=0.001),
        Known(name="forearm_mass", value=0.9, sd=0.1),
    ),
)


@pytest.fixture(scope="module")
def interpreter() -> Interpreter:
    return Interpreter.read(bank())


@pytest.fixture(scope="module", params=["sets", "any", "with a length"])
def view(interpreter: Interpreter, request: pytest.FixtureRequest) -> View:
    recording = samples(2, 1).of(*RECORDED)[0]
    if request.param == "sets":
        return interpreter.look_by_sets(recording)
    if request.param == "any":
        return interpreter.look(recording)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analysis.interpretation.inference.any_muscles.LENGTH", "forearm_length")
        view = Interpreter.fit(bank()).look(recording)
    assert view.rows.pulls is not None and np.abs(view.rows.pulls).max() > 0.0
    return view


@pytest.mark.parametrize("known", KNOWN)
def test_each_set_is_as_wide_as_it_is_by_itself(
    interpreter: Interpreter, view: View, known: tuple[Known, ...]
) -> None:
    offered = steps(interpreter, known)
    found = dict(every_plan(interpreter, view, known, {s.factor: s.to for s in offered}))
    assert len(found) == 2 ** len(offered)
    for names, width in found.items():
        done = tuple(step for step in offered if step.factor in names)
        assert set(names) == {step.factor for step in done}
        assert width == pytest.approx(half_width_after(interpreter, view, known, done))


def test_no_set_of_steps_is_shorter_and_none_that_reaches_is_passed_over(
    interpreter: Interpreter, view: View
) -> None:
    offered = steps(interpreter, ())
    sets = dict(every_plan(interpreter, view, (), {s.factor: s.to for s in offered}))
    minutes = {step.factor: step.minutes for step in offered}
    for tolerance in (width + 1e-9 for width in sets.values()):
        found = shortest_plan(interpreter, view, (), offered, tolerance)
        enough = [names for names, width in sets.items() if names and width <= tolerance]
        if not enough:
            assert found is None
            continue
        assert found is not None
        assert found[1] <= tolerance
        least = min(sum(minutes[name] for name in names) for names in enough)
        assert sum(step.minutes for step in found[0]) == least


def test_of_too_many_steps_those_that_narrow_most_are_combined(
    interpreter: Interpreter, view: View, monkeypatch: pytest.MonkeyPatch
) -> None:
    offered: list[Step] = steps(interpreter, ())
    everything = half_width_after(interpreter, view, (), tuple(offered))
    monkeypatch.setattr(plan, "MOST", 1)
    found = shortest_plan(interpreter, view, (), offered, 0.4)
    assert found is not None
    assert [step.factor for step in found[0]] == ["forearm_length"]
    found = shortest_plan(interpreter, view, (), offered, everything)
    assert found is not None
    assert found[1] <= everything
    assert shortest_plan(interpreter, view, (), [], 9.0) is None


def answered(monkeypatch: pytest.MonkeyPatch, tolerance: float, why: str | None = None) -> dict:
    """Return the answer to a made up recording that is strange for a reason."""
    nothing = np.zeros((1, 1))
    motion = Motion(time=nothing[0], theta=nothing, velocity=nothing, torque=nothing, joint=0)
    monkeypatch.setattr(Recording, "values", lambda _: samples(2, 1).of(*RECORDED)[0])
    monkeypatch.setattr(answer, "unfamiliar", lambda *_: why)
    recording = Recording(source="a.npz", device="nesm", motion=motion)
    return interpret(bank(), Question(recording=recording, tolerance=tolerance))


def test_a_step_of_a_plan_says_the_half_width_after_it_and_those_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    everything = answered(monkeypatch, 0.001)["tolerance"]["all_steps"]
    found = answered(monkeypatch, everything + 1e-9)
    planned, alone = (
        {step["factor"]: step["half_width_after"] for step in steps}
        for steps in (found["tolerance"]["plan"]["steps"], found["next"])
    )
    first, last = planned
    assert planned[first] == pytest.approx(alone[first])
    assert planned[last] == pytest.approx(found["tolerance"]["plan"]["half_width_after"])
    assert planned[first] > planned[last]


def test_a_strange_recording_says_why_there_is_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, 0.001, "it is odd")["tolerance"]
    assert found["plan"] is None and "all_steps" not in found
    assert found["why_no_plan"].startswith("the recording is not familiar")
    assert "why_no_plan" not in answered(monkeypatch, 0.001)["tolerance"]
