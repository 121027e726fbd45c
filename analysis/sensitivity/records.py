"""What the analysis is told about a study and its results."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from analysis.designs.distributions import Distribution, Scale, scales

#: An output of larger magnitude is no result: its square has no exact sum.
LARGEST_OUTPUT = 1e100


class NoSuchStudyError(LookupError):
    """The study was deleted meanwhile."""


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """What a study set out to do; nothing of it ever changes, except that `rows` may grow."""

    id: str
    #: One of `analysis.designs.METHODS`.
    method: str
    seed: int
    #: One of `analysis.designs.samplings`.
    sampling: str
    #: How many rows the study has.
    rows: int
    #: The sampled factors, in the order of the design's columns.
    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    #: Width of every factor's distribution, in its unit: what turns an effect per range into one
    #: per unit. No index depends on it.
    scales: Mapping[str, Scale] = field(default_factory=dict)


def plan_of(study: Mapping[str, Any]) -> StudyPlan:
    """Return what a study set out to do, from what `GET /v1/studies/{id}` says of it."""
    return StudyPlan(
        id=study["id"],
        method=study["method"],
        seed=study["seed"],
        sampling=study["sampling"],
        rows=study["rows"],
        factors=tuple(factor["name"] for factor in study["factors"]),
        outputs=tuple(study["outputs"]),
        scales=scales(
            {
                factor["name"]: Distribution.from_json(factor["distribution"])
                for factor in study["factors"]
            }
        ),
    )


def output_of(snapshot: Mapping[str, Any], output: str) -> Mapping[str, Any]:
    """Return what a snapshot says of an output; ValueError if the study has none of that name."""
    if output not in snapshot["outputs"]:
        known = ", ".join(snapshot["outputs"])
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    found: Mapping[str, Any] = snapshot["outputs"][output]
    return found


@dataclass(frozen=True, kw_only=True)
class LoggedResult:
    """The one final result of one instance, as the store logged it."""

    #: Place in the study's log: 1, 2, 3, ... without gaps.
    seq: int
    instance: str
    row: int
    position: int
    #: "ok", or the name of a failure.
    outcome: str
    #: Finite numbers by output name; empty unless the outcome is "ok".
    outputs: Mapping[str, float]
