"""The runs of a study one by one, some at a time."""

from typing import Any

from server.operations import watching
from server.operations.study import instances, studies
from server.records import Place, Study
from server.web.page import Look, Page
from server.web.study import sample
from server.web.study.overview import chosen, names_of, units_of

#: Runs on one page, and factors that have a column.
AT_ONCE = 50
MOST_COLUMNS = 12
STATES = ("", "ok", "failed", "quarantined", "leased", "pending")


def look(asked: Look) -> dict[str, Any]:
    """Return the runs behind the one that the address names."""
    study = studies.get(asked.engine, asked.names["study_id"])
    state = asked.choices.get("state", "")
    state = state if state in STATES else ""
    output, name, _ = chosen(study, asked.choices, None)
    after = _place(asked.choices, study)
    none = state in ("failed", "quarantined") and study.ok_count == study.result_count
    # To find none among a million takes as long as to look at all.
    found: list[dict[str, Any]] = []
    if not none:
        limit, kind = AT_ONCE + 1, state or None
        found = instances.page(
            asked.engine, study.id, state=kind, outcome=None, after=after, limit=limit
        )
    shown = [(one, (one["row"], one["position"])) for one in found[:AT_ONCE]]
    came = watching.results_at(asked.engine, study.id, [place for _, place in shown])
    factors = list(study.plan.distributions)[:MOST_COLUMNS]
    return {
        "study": study,
        "rows": [
            {
                **one,
                "point": sample.point(study, *place),
                "value": (came[place].outputs or {}).get(output) if place in came else None,
            }
            for one, place in shown
        ],
        "factors": factors,
        "left_out": len(study.plan.distributions) - len(factors),
        "units": units_of(asked.engine, study),
        "states": STATES,
        "state": state,
        "names": names_of(study),
        "output": output,
        "name": name,
        "first": after == _BEFORE,
        "begun": study.handed_out,
        "after": "{}:{}".format(*shown[-1][1]) if len(found) > AT_ONCE else "",
    }


PAGE = Page(
    path="/studies/{study_id}/runs",
    template="runs.html",
    look=look,
    choices=("state", "output", "row", "after"),
)
_BEFORE: Place = (-1, -1)


def _place(choices: Any, study: Study) -> Place:
    """Return the place behind which the runs are: that of the last page's end, or before a row."""
    row, _, position = choices.get("after", "").partition(":")
    if row.isdecimal() and position.isdecimal():
        return min(int(row), study.plan.rows), min(int(position), study.plan.width)
    if (row := choices.get("row", "")).isdecimal() and int(row):
        return min(int(row), study.plan.rows) - 1, study.plan.width
    return _BEFORE
