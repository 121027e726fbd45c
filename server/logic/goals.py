"""How precise a study is to become, and what it does when it is complete."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from analysis.sensitivity.stopping import Goal, next_step
from server.errors import InvalidStudyError
from server.logic.study import MAX_ROWS, Plan, Study, extended


@dataclass(frozen=True, kw_only=True)
class Pursuit:
    """A goal and what has been done for it."""

    goal: Goal
    #: Edition of the study (`Study.edition`) at which nothing was left to do; None before.
    judged: int | None = None
    #: Every decision: "rows" that the study had, "extended_to" or None, "reached", "sentence".
    steps: tuple[Mapping[str, Any], ...] = ()

    def settled(self, study: Study) -> bool:
        """Say whether nothing is left to do, unless somebody extends or runs the study again."""
        return study.state == "cancelled" or (
            study.state == "complete" and self.judged == study.edition
        )


def set_goal(
    plan: Plan, *, output: str | None, target: float | None, up_to: int, pointer: str = ""
) -> Goal:
    """Check a goal and complete it.

    Args:
        plan: of the study.
        output: whose indices; default: the first output.
        target: half width of every interval.
        up_to: rows that the study may have in all.
        pointer: where in the request the goal is.

    Raises:
        InvalidStudyError: with a pointer to what is wrong and a sentence saying what is right.
    """
    output = plan.outputs[0] if output is None else output
    if output not in plan.outputs:
        known = ", ".join(plan.outputs)
        raise InvalidStudyError(
            f"{pointer}/output", f"the study has no output {output!r}: it has {known}"
        )
    if target is not None and not 0.0 < target < inf:
        raise InvalidStudyError(
            f"{pointer}/target", f"target is a positive half width of an interval, not {target:g}"
        )
    if not 1 <= up_to <= MAX_ROWS:
        raise InvalidStudyError(
            f"{pointer}/up_to", f"up_to must lie between 1 and {MAX_ROWS} rows, not {up_to}"
        )
    return Goal(output=output, target=target, up_to=up_to)


def pursued(
    study: Study, pursuit: Pursuit, snapshot: Mapping[str, Any]
) -> tuple[Study, Pursuit] | None:
    """Return a study and its goal after what there is to do now; None if that is nothing.

    The rule is `analysis.sensitivity.stopping.next_step` (Sarrazin et al. 2016), which looks at a
    complete study only: a few rows early would be judged by others than those that were asked for.

    Args:
        study: as it is.
        pursuit: of its goal.
        snapshot: of all its results.
    """
    if study.state != "complete" or pursuit.settled(study):
        return None
    # A snapshot that an earlier version left may not say it.
    seen = {"sampling": study.plan.sampling, **snapshot}
    step = next_step(seen, pursuit.goal, study.plan.rows)
    if step is None:
        return None
    said = {
        "rows": study.plan.rows,
        "extended_to": step.rows,
        "reached": step.reached,
        "sentence": step.sentence,
    }
    after = study if step.rows is None else extended(study, step.rows)
    return after, replace(
        pursuit,
        judged=study.edition if step.rows is None else None,
        steps=(*pursuit.steps, said),
    )


def shown(study: Study, pursuit: Pursuit | None) -> dict[str, Any] | None:
    """Return a goal as the interface shows it; None if there is none."""
    if pursuit is None:
        return None
    goal, settled = pursuit.goal, pursuit.settled(study)
    return {
        "output": goal.output,
        "target": goal.target,
        "up_to": goal.up_to,
        "settled": settled,
        "reached": settled and bool(pursuit.steps) and bool(pursuit.steps[-1]["reached"]),
        "steps": [dict(step) for step in pursuit.steps],
    }
