"""What failed in a study: by cause, where in the space of its factors, and one example of each."""

import json
from collections import Counter
from typing import Any

from analysis.designs import family
from analysis.reports import tables
from analysis.reports.figures import failures
from analysis.sensitivity.judgement.ranking import RANKED_BY
from analysis.sensitivity.remarks import warning
from server.logic.study.instances import BUDGETS
from server.operations import watching
from server.operations.study import studies
from server.records import Study
from server.web.page import Look, Page
from server.web.study import sample
from server.web.study.overview import snapshot_of, units_of

#: Failed results that are looked at, and of which the factors are drawn; as many of good ones.
MOST_SEEN = 500
MOST_DRAWN = 200
#: Characters of what a simulation said when it failed.
MOST_SAID = 6000


def look(asked: Look) -> dict[str, Any]:
    """Return a study's failures."""
    study = studies.get(asked.engine, asked.names["study_id"])
    seen = watching.latest_failed(asked.engine, study, limit=MOST_SEEN)
    snapshot = snapshot_of(asked, study)
    x, y = _axes(study, snapshot, asked)
    groups = [
        {
            "cause": cause,
            "count": count,
            "share": count / study.result_count,
            "quarantined": cause in BUDGETS,
            "hosts": Counter(one["host"] for one in seen if one["outcome"] == cause),
            "example": _example(next((o for o in seen if o["outcome"] == cause), None)),
        }
        for cause, count in sorted(study.failures.items(), key=lambda item: -item[1])
        if count
    ]
    return {
        "study": study,
        "groups": groups,
        "seen": len(seen),
        "failed": study.result_count - study.ok_count,
        "warning": warning(snapshot),
        # A snapshot that an earlier version left may not say it.
        "blocks": tables.failures(snapshot) if snapshot.get("failure", {}).get("failed") else [],
        "factors": list(study.plan.distributions),
        "x": x,
        "y": y,
        "units": units_of(asked.engine, study),
        "figures": {"failures": _figure(asked, study, seen, x, y)},
    }


PAGE = Page(
    path="/studies/{study_id}/failures", template="failures.html", look=look, choices=("x", "y")
)


def _axes(study: Study, snapshot: dict[str, Any], asked: Look) -> tuple[str, str]:
    """Return the two factors that are asked for, else those that failing depends on most."""
    found = snapshot.get("failure", {}).get("factors", {})
    by = RANKED_BY[family(study.plan.method)]
    ranked = [*study.plan.distributions]
    if found:
        ranked.sort(key=lambda name: -(found[name][by]["value"] or 0.0))
    first, second = (*ranked, *ranked)[:2]
    x, y = asked.choices.get("x", first), asked.choices.get("y", second)
    known = study.plan.distributions
    return (x if x in known else first), (y if y in known else second)


def _figure(
    asked: Look, study: Study, seen: list[dict[str, Any]], x: str, y: str
) -> dict[str, Any] | None:
    if not seen:
        return None
    share = max(1, MOST_DRAWN // len({one["outcome"] for one in seen}))
    failed: dict[str, list[dict[str, float]]] = {}
    since = study.result_count
    for one in seen:
        runs = failed.setdefault(one["outcome"], [])
        if len(runs) < share:
            runs.append(sample.point(study, one["row"], one["position"]))
            since = min(since, one["seq"])
    # Of the same part of the study as those that failed, and at any position of a row as they are.
    good = [
        sample.point(study, row, position)
        for row, position in watching.good_among(asked.engine, study, since=since, limit=MOST_DRAWN)
    ]
    # A run that is counted no more, as it was run again meanwhile, is drawn until the next look.
    of = {cause: max(study.failures.get(cause, 0), len(runs)) for cause, runs in failed.items()}
    return failures(good, failed, x, y, of | {"ok": max(study.ok_count, len(good))})


def _example(one: dict[str, Any] | None) -> dict[str, Any] | None:
    if one is None:
        return None
    state = dict(one["state"] or {})
    traceback = state.pop("traceback", "")
    said = json.dumps(state, indent=1, ensure_ascii=False)[:MOST_SAID] if state else ""
    return {**one, "traceback": str(traceback)[-MOST_SAID:], "said": said}
