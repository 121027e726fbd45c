"""What a request for a study is refused for, besides what makes it no study."""

from collections.abc import Mapping
from typing import Any

from analysis.sensitivity.fewer_runs.limits import LOOKS
from server.errors import InvalidStudyError
from server.records import Plan

#: How keys begin that say how factors depend on each other.
_DEPENDENCE = ("correlat", "covarian", "copula", "depend", "joint")


def refuse_too_few(plan: Plan) -> None:
    """Refuse a plan that would be complete before anything is told of it.

    Raises:
        InvalidStudyError: with a pointer to its rows.
    """
    if plan.method == "surrogate" and plan.rows < LOOKS[0]:
        raise InvalidStudyError(
            "/rows",
            f"surrogate fits its first function to {LOOKS[0]} rows, and would tell nothing of "
            f"{plan.rows}",
        )


def refuse_dependence(body: Any) -> None:
    """Refuse a request, as JSON, that says how factors depend on each other in words unknown here.

    They would only be told that the key is unknown.

    Raises:
        InvalidStudyError: with a pointer to the first such key of the study, of one of its factors
            or of a factor's distribution.
    """
    known = ("correlations", "correlation_kind")
    places = [("", body)]
    factors = body.get("factors") if isinstance(body, Mapping) else None
    for i, factor in enumerate(factors if isinstance(factors, list) else []):
        places.append((f"/factors/{i}", factor))
        if isinstance(factor, Mapping):
            places.append((f"/factors/{i}/distribution", factor.get("distribution")))
    for pointer, place in places:
        for key in map(str, place if isinstance(place, Mapping) else ()):
            if key.lower().startswith(_DEPENDENCE) and not (place is body and key in known):
                name = key.replace("~", "~0").replace("/", "~1")
                raise InvalidStudyError(
                    f"{pointer}/{name}",
                    f"{key}: how factors depend on each other is said by the study's correlations, "
                    'as [["a", "b", 0.6]], and by its correlation_kind, rank or linear',
                )
