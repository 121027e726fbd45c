"""Two studies side by side: what they share, where they differ, and their indices."""

from typing import Any

from analysis.designs import family
from analysis.reports import tables
from analysis.reports.figures import comparison
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.ranking import RANKED_BY
from server.operations.study import studies
from server.records import Study
from server.web.page import Look, Page
from server.web.study.overview import names_of, snapshot_of

#: Studies that can be chosen, the latest ones.
MOST_LISTED = 300


def look(asked: Look) -> dict[str, Any]:
    """Return two studies and what can be said of both."""
    every = sorted(studies.every(asked.engine), key=lambda s: -s.created_at)
    first = _chosen(asked, "a", every, others=())
    second = _chosen(asked, "b", every, others=(first,)) if first else None
    content: dict[str, Any] = {
        "studies": every[:MOST_LISTED],
        "first": first,
        "second": second,
        "outputs": [],
        "output": "",
        "facts": None,
        "indices": None,
        "why_not": "",
        "figures": {"comparison": None},
    }
    if first is None or second is None:
        return content
    common = [name for name in names_of(first) if name in names_of(second)]
    content["facts"] = _facts(first, second)
    if not common:
        return content | {"why_not": "They have no output in common."}
    output = asked.choices.get("output", "")
    output = output if output in common else common[0]
    content |= {"outputs": common, "output": output}
    if family(first.plan.method) != family(second.plan.method):
        return content | {
            "why_not": "Elementary effects, shares of the variance and Shapley effects are "
            "different things: only their order can be compared, which each study's page has."
        }
    both = (snapshot_of(asked, first), snapshot_of(asked, second))
    drawn = comparison(both, (first.plan.name, second.plan.name), output)
    return content | {
        "indices": _indices(both, output, RANKED_BY[family(first.plan.method)]),
        "figures": {"comparison": drawn if drawn["data"] else None},
    }


PAGE = Page(path="/compare", template="compare.html", look=look, choices=("a", "b", "output"))


def _chosen(
    asked: Look, which: str, every: list[Study], *, others: tuple[Study, ...]
) -> Study | None:
    """Return the study that is asked for, else the latest that fits best beside the other."""
    if wanted := asked.choices.get(which):
        return studies.get(asked.engine, wanted)
    left = [study for study in every if study.id not in {other.id for other in others}]
    alike = [s for s in left if all(s.plan.model == other.plan.model for other in others)]
    return next(iter(alike or left), None)


def _facts(first: Study, second: Study) -> tables.Grid:
    """Return what the two are, line by line, and which lines differ."""
    said = [_said(study) for study in (first, second)]
    names = list(dict.fromkeys([*said[0], *said[1]]))
    rows = [[name, *(one.get(name, "–") for one in said)] for name in names]
    return tables.Grid(
        head=["", first.plan.name, second.plan.name, ""],
        rows=[[*row, "" if row[1] == row[2] else "differs"] for row in rows],
    )


def _said(study: Study) -> dict[str, str]:
    plan = study.plan
    ranges = {name: tables.distribution(one.to_json()) for name, one in plan.distributions.items()}
    return {
        "model": plan.model,
        "method": f"{plan.method}, {plan.sampling}",
        "seed": str(plan.seed),
        "rows": f"{study.rows_complete:,} of {plan.rows:,}",
        "failed runs": f"{study.result_count - study.ok_count:,} of {study.result_count:,}",
        **ranges,
        **{name: f"fixed at {value:g}" for name, value in plan.fixed.items()},
    }


def _indices(both: tuple[dict[str, Any], dict[str, Any]], output: str, index: str) -> tables.Grid:
    """Return the index that both are ranked by, and whether its intervals part."""
    found = [snapshot["outputs"][output]["factors"] for snapshot in both]
    rows: list[list[object]] = []
    for name in dict.fromkeys([*found[0], *found[1]]):
        pair = [factors[name][index] if name in factors else None for factors in found]
        rows.append([name, *pair, _apart(*pair)])
    rows.sort(key=lambda row: -max(one["value"] or 0.0 for one in row[1:3] if one))  # type: ignore[index]
    symbol = SYMBOLS[index]
    return tables.Grid(
        head=["factor", f"{symbol}, first", f"{symbol}, second", "intervals"], rows=rows
    )


def _apart(one: dict[str, Any] | None, other: dict[str, Any] | None) -> str:
    if one is None or other is None:
        return "only one samples it"
    if None in (*one.values(), *other.values()):
        return "–"
    apart = one["high"] < other["low"] or other["high"] < one["low"]
    return "apart" if apart else "overlap"
