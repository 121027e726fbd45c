"""How precise a study shall become."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from analysis.sensitivity.judgement import stopping
from server.errors import InvalidStudyError
from server.logic.study import precision_goals
from server.logic.study.plans import MAX_ROWS
from server.records import Plan, PrecisionGoal, Study
from server.states import StudyState

GOAL = PrecisionGoal(output="y", target=0.1, up_to=64)


@pytest.fixture
def complete(plan: Callable[..., Plan]) -> Callable[..., Study]:
    """A complete study of two rows, at its third edition."""

    def make(**changes: Any) -> Study:
        standing: dict[str, Any] = {"state": "complete", "edition": 3, "finished_at": 4.0}
        standing |= changes
        standing["state"] = StudyState(standing["state"])
        return Study(id="s", plan=plan(), created_at=0.0, **standing)

    return make


@pytest.mark.parametrize(
    ("state", "judged", "settled"),
    [
        ("cancelled", None, True),
        ("complete", 3, True),
        ("complete", 2, False),
        ("complete", None, False),
        ("running", 3, False),
    ],
)
def test_a_goal_is_settled_when_this_edition_was_judged_or_the_study_cancelled(
    complete: Callable[..., Study], state: str, judged: int | None, settled: bool
) -> None:
    goal = PrecisionGoal(output="y", target=0.1, up_to=64, judged=judged)
    assert precision_goals.is_settled(complete(state=state), goal) is (settled)


def test_a_goal_is_for_the_first_output_unless_told_otherwise(plan: Callable[..., Plan]) -> None:
    assert precision_goals.precision_goal(plan(), output=None, target=None, up_to=2) == (
        PrecisionGoal(output="y", target=None, up_to=2)
    )
    asked = precision_goals.precision_goal(plan(), output="y", target=1e-9, up_to=MAX_ROWS)
    assert asked == PrecisionGoal(output="y", target=1e-9, up_to=MAX_ROWS)


def test_a_sample_has_no_index_that_could_become_precise(plan: Callable[..., Plan]) -> None:
    with pytest.raises(InvalidStudyError, match="method sample has no indices") as refused:
        precision_goals.precision_goal(
            replace(plan(), method="sample"), output=None, target=None, up_to=8, pointer="/goal"
        )
    assert refused.value.pointer == "/goal"


def test_no_surrogate_grows_beyond_what_a_function_is_fitted_to(plan: Callable[..., Plan]) -> None:
    drawn, wanted = plan(method="surrogate", rows=128), {"output": None, "target": 0.02}
    with pytest.raises(InvalidStudyError, match="512 rows at most: up_to cannot be 513") as refused:
        precision_goals.precision_goal(drawn, **wanted, up_to=513, pointer="/precision")
    assert refused.value.pointer == "/precision/up_to"
    assert precision_goals.precision_goal(drawn, **wanted, up_to=512).up_to == 512


@pytest.mark.parametrize(
    ("wrong", "pointer", "says"),
    [
        ({"output": "z"}, "/goal/output", "the study has no output 'z': it has y"),
        ({"target": 0.0}, "/goal/target", "target is a positive half width"),
        ({"target": float("inf")}, "/goal/target", "not inf"),
        ({"up_to": 0}, "/goal/up_to", f"between 1 and {MAX_ROWS} rows, not 0"),
        ({"up_to": MAX_ROWS + 1}, "/goal/up_to", f"not {MAX_ROWS + 1}"),
    ],
)
def test_a_goal_that_cannot_be_is_refused_where_it_is_wrong(
    plan: Callable[..., Plan], wrong: dict[str, Any], pointer: str, says: str
) -> None:
    asked: dict[str, Any] = {"output": None, "target": None, "up_to": 8, **wrong}
    with pytest.raises(InvalidStudyError) as refused:
        precision_goals.precision_goal(plan(), **asked, pointer="/goal")
    assert refused.value.pointer == pointer
    assert says in str(refused.value)


def test_a_share_of_a_variance_is_not_wanted_to_half_of_what_it_can_be(
    plan: Callable[..., Plan],
) -> None:
    asked: dict[str, Any] = {"output": None, "target": 0.5, "up_to": 8, "pointer": "/goal"}
    with pytest.raises(InvalidStudyError, match=r"below 0\.5, not 0\.5") as refused:
        precision_goals.precision_goal(plan(method="saltelli"), **asked)
    assert refused.value.pointer == "/goal/target"
    assert precision_goals.precision_goal(plan(method="morris"), **asked).target == 0.5


def decided(monkeypatch: pytest.MonkeyPatch, step: stopping.Step | None) -> list[Any]:
    asked: list[Any] = []

    def next_step(*given: Any) -> stopping.Step | None:
        asked.append(given)
        return step

    monkeypatch.setattr(precision_goals, "next_step", next_step)
    return asked


def test_a_step_to_more_rows_extends_the_study_and_is_kept(
    complete: Callable[..., Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = decided(monkeypatch, stopping.Step(rows=8, reached=False, sentence="More."))
    found = precision_goals.next_extension(complete(), GOAL, {"outputs": {}})
    assert found is not None
    study, goal = found
    assert (study.plan.rows, study.state, goal.judged) == (8, "running", None)
    assert goal.steps == ({"rows": 2, "extended_to": 8, "reached": False, "sentence": "More."},)
    assert asked == [({"sampling": "sobol", "outputs": {}}, GOAL, 2)]


def test_a_step_to_none_settles_the_goal_at_this_edition(
    complete: Callable[..., Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    decided(monkeypatch, stopping.Step(rows=None, reached=True, sentence="There."))
    found = precision_goals.next_extension(complete(), GOAL, {"sampling": "latin"})
    assert found is not None
    study, goal = found
    assert (study, goal.judged) == (complete(), 3)
    assert precision_goals.shown(study, goal) == {
        "output": "y",
        "target": 0.1,
        "up_to": 64,
        "settled": True,
        "reached": True,
        "steps": [{"rows": 2, "extended_to": None, "reached": True, "sentence": "There."}],
    }


def test_nothing_is_decided_while_a_study_runs_or_its_goal_is_settled(
    complete: Callable[..., Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = decided(monkeypatch, None)
    running = complete(state="running")
    judged = PrecisionGoal(output="y", target=0.1, up_to=64, judged=3)
    assert precision_goals.next_extension(running, GOAL, {}) is None
    assert precision_goals.next_extension(complete(), judged, {}) is None
    assert asked == []
    assert precision_goals.next_extension(complete(), GOAL, {}) is None
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("judged", "reached", "shows"), [(3, True, True), (3, False, False), (None, True, False)]
)
def test_a_goal_is_reached_only_when_its_last_step_said_so_and_nothing_came_after(
    complete: Callable[..., Study], judged: int | None, reached: bool, shows: bool
) -> None:
    steps = ({"reached": True}, {"reached": reached})
    goal = PrecisionGoal(output="y", target=None, up_to=8, judged=judged, steps=steps)
    shown = precision_goals.shown(complete(), goal)
    assert shown is not None and (shown["reached"], shown["settled"]) == (shows, judged == 3)


def test_a_study_without_a_goal_shows_none(complete: Callable[..., Study]) -> None:
    assert precision_goals.shown(complete(), None) is None
    nothing_done = PrecisionGoal(output="y", target=None, up_to=8, judged=3)
    shown = precision_goals.shown(complete(), nothing_done)
    assert shown is not None and shown["reached"] is False


def test_a_goal_of_a_curve_is_one_output_and_is_refused_at_the_root_without_a_pointer(
    plan: Callable[..., Plan],
) -> None:
    curved = plan(model="elbow", outputs=["torque_over_phase", "stiffness_error"])
    asked = precision_goals.precision_goal(curved, output="torque_over_phase", target=None, up_to=8)
    assert asked.output == "torque_over_phase"
    with pytest.raises(InvalidStudyError) as refused:
        precision_goals.precision_goal(curved, output="z", target=None, up_to=8)
    assert (refused.value.pointer, str(refused.value)) == (
        "/output",
        "the study has no output 'z': it has stiffness_error, torque_over_phase",
    )
