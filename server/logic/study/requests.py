"""What a request for a study is refused for, besides what makes it no study."""

import re
from collections.abc import Mapping
from typing import Any

from analysis.sensitivity.fewer_runs.limits import LOOKS
from server.errors import InvalidStudyError
from server.records import Plan

#: How keys begin that say how factors depend on each other.
_DEPENDENCE = ("correlat", "covarian", "copula", "depend", "joint")

#: Values of a discrete distribution: every lease and every answer about the study has them all.
MOST_VALUES = 1000
#: Entries of any other list or object of a request, and of all of them together.
MOST_ENTRIES, MOST_IN_ALL = 10_000, 100_000
_OF_DISTRIBUTION = re.compile(r"/factors/\d+/distribution/[^/]*")


def refuse_too_much(body: Any) -> None:
    """Refuse a request, as JSON, with more in it than a study has, before any of it is looked at.

    To tell of every fault of millions of entries would take minutes.

    Raises:
        InvalidStudyError: with a pointer to the first list or object that is too long.
    """
    left, places = MOST_IN_ALL, [("", body)] if _holds(body) else []
    while places:
        pointer, place = places.pop()
        _refuse_long(pointer, place)
        left -= len(place)
        if left < 0:
            raise InvalidStudyError(
                "", f"a study may have {MOST_IN_ALL} entries at most, in all of its lists together"
            )
        inside = place.items() if isinstance(place, Mapping) else enumerate(place)
        places += [(f"{pointer}/{_escaped(key)}", one) for key, one in inside if _holds(one)]


def _holds(value: Any) -> bool:
    return isinstance(value, Mapping | list)


def _refuse_long(pointer: str, place: Any) -> None:
    if _OF_DISTRIBUTION.fullmatch(pointer) and len(place) > MOST_VALUES:
        raise InvalidStudyError(
            pointer,
            f"a discrete distribution may have {MOST_VALUES} values at most, not {len(place)}: "
            "merge those that lie close, or give the distribution that they are drawn from",
        )
    if len(place) > MOST_ENTRIES:
        raise InvalidStudyError(
            pointer,
            f"a list or object of a study may have {MOST_ENTRIES} entries at most, "
            f"not {len(place)}",
        )


def _escaped(key: Any) -> str:
    """Return a key as a part of a JSON pointer."""
    return str(key).replace("~", "~0").replace("/", "~1")


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
                raise InvalidStudyError(
                    f"{pointer}/{_escaped(key)}",
                    f"{key}: how factors depend on each other is said by the study's correlations, "
                    'as [["a", "b", 0.6]], and by its correlation_kind, rank or linear',
                )
