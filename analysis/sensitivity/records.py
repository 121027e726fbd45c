"""What the analysis is told about a study and its results."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from analysis.designs.distributions import Distribution, Normal, Scale, scales
from analysis.designs.groups import units_of
from models.curves import Curve, columns_of

#: An output of larger magnitude is no result: its square has no exact sum.
LARGEST_OUTPUT = 1e100


#: What is said of a curve as of any output, beside its generalised indices.
_OF_WHOLE = ("trust", "ranking", "screening")


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
    #: Of a curve, every point.
    outputs: tuple[str, ...]
    #: Factors that move together, by the name of their group.
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: The outputs that are curves, by name.
    curves: Mapping[str, Curve] = field(default_factory=dict)
    #: Width of every factor's distribution, in its unit: what turns an effect per range into one
    #: per unit. No index depends on it.
    scales: Mapping[str, Scale] = field(default_factory=dict)
    #: The factors that are normal, which surrogates take in standard deviations.
    normal: frozenset[str] = frozenset()

    @cached_property
    def units(self) -> Mapping[str, tuple[str, ...]]:
        """What indices are of, groups and factors that are in none, with their factors."""
        return units_of(self.factors, self.groups)


def plan_of(study: Mapping[str, Any]) -> StudyPlan:
    """Return what a study set out to do, from what `GET /v1/studies/{id}` says of it."""
    curves = curves_of(study)
    distributions = {
        factor["name"]: Distribution.from_json(factor["distribution"])
        for factor in study["factors"]
    }
    return StudyPlan(
        id=study["id"],
        method=study["method"],
        seed=study["seed"],
        sampling=study["sampling"],
        rows=study["rows"],
        factors=tuple(factor["name"] for factor in study["factors"]),
        outputs=columns_of(study["outputs"], curves),
        curves=curves,
        groups={name: tuple(members) for name, members in study.get("groups", {}).items()},
        scales=scales(distributions),
        normal=normals(distributions),
    )


def normals(distributions: Mapping[str, Distribution]) -> frozenset[str]:
    """Return which factors are normal."""
    return frozenset(name for name, one in distributions.items() if isinstance(one, Normal))


def curves_of(study: Mapping[str, Any]) -> dict[str, Curve]:
    """Return the curves among a study's outputs, from what `GET /v1/studies/{id}` says of it."""
    # Studies of before there were any have no entry.
    return {name: Curve.from_json(said) for name, said in study.get("curves", {}).items()}


def output_of(snapshot: Mapping[str, Any], output: str) -> Mapping[str, Any]:
    """Return what a snapshot says of an output; ValueError if the study has none of that name.

    Of a curve, what it says of the whole.
    """
    curves = snapshot.get("curves", {})
    if output in curves:
        said = curves[output]
        return {**said["whole"], **{name: said[name] for name in _OF_WHOLE}}
    if output not in snapshot["outputs"]:
        known = ", ".join((*snapshot["outputs"], *curves))
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    found: Mapping[str, Any] = snapshot["outputs"][output]
    return found


def said_of(snapshot: Mapping[str, Any], output: str) -> Mapping[str, Any]:
    """Return `output_of`; an empty mapping if the snapshot says nothing of an output."""
    if output in snapshot["outputs"] or output in snapshot.get("curves", {}):
        return output_of(snapshot, output)
    return {}


def curves_as_outputs(snapshot: Mapping[str, Any]) -> dict[str, Any]:
    """Return a snapshot whose curves stand among its outputs, with what is said of the whole.

    What an output has and a whole curve has not is null, and its convergence is empty.
    """
    shares = ("first_order", "total_order")
    indices = ("mu", "mu_star", "sigma") if snapshot["method"] == "morris" else shares
    unknown = dict.fromkeys(("value", "low", "high"))
    said: dict[str, Any] = {}
    for name in snapshot.get("curves", {}):
        of_whole = output_of(snapshot, name)
        factors = {
            factor: {
                **dict.fromkeys(indices, unknown),
                "per_unit": None,
                "worst_case": None,
                **found,
            }
            for factor, found in of_whole["factors"].items()
        }
        line: dict[str, Any] = {index: {"value": [], "low": [], "high": []} for index in indices}
        said[name] = {
            "mean": None,
            "sd": None,
            "n": snapshot["curves"][name]["n"],
            **of_whole,
            "factors": factors,
            "convergence": {
                "rows": [],
                "factors": dict.fromkeys(factors, line),
                "second_order": [],
            },
        }
    return {**snapshot, "outputs": {**snapshot["outputs"], **said}}


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
