"""What an evaluation gives: numbers, or the name of a failure."""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from typing import Any

from models.description import Description

_OUTCOME = re.compile(r"[a-z][a-z0-9_]{0,39}")
#: Success, where an instance stands, and what only a coordinator concludes.
NO_FAILURES = frozenset({"ok", "pending", "leased", "done", "quarantined", "lost", "invalid"})

#: Why no worker takes a model that says that it is deterministic and is not.
NOT_DETERMINISTIC = (
    "it gives other numbers at the same point with another seed, or the second time; a model with "
    "noise of its own says `deterministic = false`"
)

#: What the four kinds have in common: parameters and a seed in, outputs or a ModelFailure out.
Evaluator = Callable[[Mapping[str, float], int], Mapping[str, float]]


class ModelFailure(Exception):  # noqa: N818 (named by the contract)
    """A model says that it has no answer at these parameters.

    Args:
        outcome: the failure's name: lower-case letters, digits and _, such as "diverged".
        reason: one sentence for a reader.
        state: what else would help to see why, as JSON.
    """

    def __init__(self, outcome: str, reason: str, state: Mapping[str, Any] | None = None) -> None:
        if not _OUTCOME.fullmatch(outcome) or outcome in NO_FAILURES:
            raise ValueError(
                f"outcome {outcome[:80]!r} must be 1 to 40 of a to z, 0 to 9 and _, and none of "
                f"{', '.join(sorted(NO_FAILURES))}"
            )
        self.outcome, self.reason, self.state = outcome, reason, state
        super().__init__(f"{outcome}: {reason}")


class ModelAway(Exception):  # noqa: N818 (as ModelFailure)
    """What evaluates a model does not answer, which says nothing of the parameters."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What became of one point: outputs, or the name of a failure."""

    #: "ok", or the name of a failure.
    outcome: str
    #: Every output of the model; empty unless `outcome` is "ok".
    outputs: Mapping[str, float]
    #: One sentence for a reader; empty when `outcome` is "ok".
    reason: str = ""
    #: Where the simulation stood when it failed, as JSON; None when it succeeded.
    state: Mapping[str, Any] | None = None
    wall_seconds: float


def columns(description: Description, outputs: Any) -> dict[str, float]:
    """Return a model's answer as one number for each of its columns, in the description's order.

    Raises:
        ModelFailure: "bad_answer": it is no mapping, an output is missing, unknown, not a number,
            or a curve of another length; "not_finite".
    """
    if not isinstance(outputs, Mapping):
        kind = type(outputs).__name__
        raise ModelFailure("bad_answer", f"outputs must be numbers by name, not of type {kind}")
    expected = {output.name: output for output in description.results}
    for name in outputs:
        if name not in expected:
            raise ModelFailure("bad_answer", f"output {str(name)[:80]!r} is not in its description")
    found: dict[str, float] = {}
    for name, output in expected.items():
        if name not in outputs:
            raise ModelFailure("bad_answer", f"output {name} is missing")
        value = outputs[name]
        points = [value] if output.curve is None else _points(name, value, output.curve)
        found |= {
            column: _number(column, point)
            for column, point in zip(output.columns, points, strict=True)
        }
    return found


def _points(name: str, value: Any, count: int) -> Sequence[Any]:
    points = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(points, Sequence) or isinstance(points, str):
        raise ModelFailure("bad_answer", f"output {name} must be a list of {count} numbers")
    if len(points) != count:
        raise ModelFailure(
            "bad_answer", f"output {name} must be a list of {count} numbers, not of {len(points)}"
        )
    return points


def _number(name: str, value: Any) -> float:
    number = None
    if not isinstance(value, str | bool):
        with suppress(TypeError, ValueError, OverflowError):
            number = float(value)
    if number is None:
        raise ModelFailure("bad_answer", f"output {name} must be a number, not {str(value)[:60]!r}")
    if not isfinite(number):
        raise ModelFailure("not_finite", f"{name} came out as {number}")
    return number
