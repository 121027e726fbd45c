"""How precise a study shall become, and what it does when it is complete."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from analysis.sensitivity.fewer_runs.limits import MOST_RUNS
from analysis.sensitivity.judgement.stopping import Step, check_target, next_step
from models.curves import names_of
from server.errors import InvalidStudyError
from server.logic.study.plans import MAX_ROWS
from server.logic.study.studies import extended
from server.records import Plan, PrecisionGoal, Study
from server.states import StudyState


def is_settled(study: Study, goal: PrecisionGoal) -> bool:
    """Say whether nothing is left to do, unless somebody extends or reruns the study."""
    return study.state == StudyState.CANCELLED or (
        study.state == StudyState.COMPLETE and goal.judged == study.edition
    )


def precision_goal(
    plan: Plan, *, output: str | None, target: float | None, up_to: int, pointer: str = ""
) -> PrecisionGoal:
    """Check a goal and complete it.

    Args:
        output: whose indices; default: the first output.
        up_to: rows that the study may have in all.
        pointer: where in the request the goal is.

    Raises:
        InvalidStudyError: with a pointer to what is wrong and a sentence saying what is right.
    """
    if plan.method == "sample":
        raise InvalidStudyError(
            pointer, "a study of method sample has no indices, so none can become precise"
        )
    names = names_of(plan.outputs, plan.curves)
    output = names[0] if output is None else output
    if output not in names:
        known = ", ".join(names)
        raise InvalidStudyError(
            f"{pointer}/output", f"the study has no output {output!r}: it has {known}"
        )
    try:
        check_target(target, plan.method)
    except ValueError as error:
        raise InvalidStudyError(f"{pointer}/target", str(error)) from None
    if not 1 <= up_to <= MAX_ROWS:
        raise InvalidStudyError(
            f"{pointer}/up_to", f"up_to must lie between 1 and {MAX_ROWS} rows, not {up_to}"
        )
    if up_to < plan.rows:
        raise InvalidStudyError(
            f"{pointer}/up_to",
            f"up_to must be {plan.rows} or more, the rows that the study has already, not {up_to}",
        )
    if plan.method == "surrogate" and up_to > MOST_RUNS:
        raise InvalidStudyError(
            f"{pointer}/up_to",
            f"surrogate fits a function to {MOST_RUNS} rows at most: up_to cannot be {up_to}",
        )
    return PrecisionGoal(output=output, target=target, up_to=up_to)


def next_extension(
    study: Study, goal: PrecisionGoal, snapshot: Mapping[str, Any]
) -> tuple[Study, PrecisionGoal] | None:
    """Return a study and its goal after what there is to do now; None if that is nothing.

    The rule is `analysis.sensitivity.judgement.stopping.next_step` (Sarrazin et al. 2016), which
    looks at a complete study only: a few rows early would be judged by others than those that were
    asked for.

    `snapshot` is of all the study's results.
    """
    if study.state != StudyState.COMPLETE or is_settled(study, goal):
        return None
    # A snapshot that an earlier version left may not say it.
    seen = {"sampling": study.plan.sampling, **snapshot}
    step = next_step(seen, goal, study.plan.rows)
    if step is None:
        return None
    after = study if step.rows is None else extended(study, step.rows)
    return after, _taken(study, goal, step)


def unjudged(study: Study, goal: PrecisionGoal) -> PrecisionGoal:
    """Return a goal after an error of ours kept the study from being judged, which ends it.

    To try again would fail again; somebody who sets the goal anew has it tried.
    """
    said = (
        f"Whether the indices of {goal.output} are as precise as wanted could not be told, an "
        "error of rehyb: please report what the log of the analysis says. It is not extended."
    )
    return _taken(study, goal, Step(rows=None, reached=False, sentence=said))


def _taken(study: Study, goal: PrecisionGoal, step: Step) -> PrecisionGoal:
    """Return a goal with one more step."""
    said = {
        "rows": study.plan.rows,
        "extended_to": step.rows,
        "reached": step.reached,
        "sentence": step.sentence,
    }
    judged = study.edition if step.rows is None else None
    return replace(goal, judged=judged, steps=(*goal.steps, said))


def shown(study: Study, goal: PrecisionGoal | None) -> dict[str, Any] | None:
    """Return a goal as the interface shows it; None if there is none."""
    if goal is None:
        return None
    settled = is_settled(study, goal)
    return {
        "output": goal.output,
        "target": goal.target,
        "up_to": goal.up_to,
        "settled": settled,
        "reached": settled and bool(goal.steps) and bool(goal.steps[-1]["reached"]),
        "steps": [dict(step) for step in goal.steps],
    }
