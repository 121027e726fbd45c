"""The form of a new study: what its model has, how many runs it would be, how long they take."""

import json
from typing import Any

from analysis.designs import DEFAULT_SAMPLING, METHODS, fewest_factors, row_width, samplings
from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.study.plans import MAX_ROWS
from server.operations import models, watching
from server.operations.study import studies
from server.web.page import Look, Page

#: Rows that the form begins with, by method.
ROWS = dict.fromkeys(METHODS, 256) | {"morris": 20}

#: Seconds that a run takes a worker at least: to be handed out and to come back costs as much.
LEAST_SECONDS = 0.0015


def look(asked: Look) -> dict[str, Any]:
    """Return the model that is asked for, and what the form computes with."""
    every = models.every(asked.engine)
    wanted = asked.choices.get("model") or every[0].name
    model = models.get(asked.engine, wanted)
    method = asked.choices.get("method", "morris")
    method = method if method in METHODS else "morris"
    factors = model.description.factors
    alike = [s for s in studies.every(asked.engine) if s.plan.model in (model.name, model.called)]
    seconds = watching.mean_seconds(asked.engine, alike)
    fleet = watching.fleet(asked.engine)
    return {
        "names": [one.name for one in every],
        "model": model,
        "methods": list(METHODS),
        "method": method,
        "samplings": list(samplings(method)),
        "sampling": DEFAULT_SAMPLING,
        "rows": ROWS[method],
        "most_rows": MAX_ROWS,
        "outputs": model.description.outputs[:500],
        "computes": json.dumps(
            {
                "model": model.name,
                # Runs in one row, by how many factors are sampled.
                "widths": [
                    row_width(method, number) if number >= fewest_factors(method) else None
                    for number in range(len(factors) + 1)
                ],
                "seconds": None if seconds is None else max(seconds, LEAST_SECONDS),
                "workers": sum(w.last_seen > asked.now - GONE_SECONDS for w in fleet.workers),
            }
        ),
    }


PAGE = Page(path="/new-study", template="new_study.html", look=look, choices=("model", "method"))
