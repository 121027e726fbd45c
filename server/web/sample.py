"""Some runs of a study, from which a page draws distributions, scatter plots and pairs.

However large a study is, these are of its first rows, whose points fill the factor space evenly as
all of them do; they are looked for again when the rows have doubled, so an open page costs little.
"""

import json
from collections import OrderedDict
from threading import Lock
from typing import Any

from sqlalchemy.engine import Engine

from server.logic.study.points import parameters
from server.operations import watching
from server.records import Study

#: Rows that are looked at; of each the first point, which is independent of the other rows'.
MOST_ROWS = 1024
#: Answers that are remembered, and points.
MOST_KEPT = 16
MOST_POINTS = 10_000

_points: OrderedDict[tuple[str, int, int, int], dict[str, float]] = OrderedDict()
_answers: OrderedDict[tuple[Any, ...], bytes] = OrderedDict()
_lock = Lock()


def version(study: Study) -> tuple[int, int]:
    """Return what changes when there is more to see: the edition, and the rows in powers of two."""
    complete = min(study.rows_complete, MOST_ROWS)
    whole = complete if complete == study.plan.rows else 1 << complete.bit_length() >> 1
    return study.edition, whole


def point(study: Study, row: int, position: int) -> dict[str, float]:
    """Return the factors of a run; most are asked for again with every look."""
    key = (study.id, study.edition, row, position)
    with _lock:
        found = _points.get(key)
    if found is None:
        every = parameters(study.plan, row)[position]
        found = {name: every[name] for name in study.plan.distributions}
        with _lock:
            _points[key] = found
            while len(_points) > MOST_POINTS:
                _points.popitem(last=False)
    return found


def runs(engine: Engine, study: Study, output: str) -> bytes:
    """Return the runs as JSON: {"rows", "of", "factors", "columns", "output", "outcomes"}."""
    edition, rows = version(study)
    key = (study.id, edition, rows, output)
    with _lock:
        if key in _answers:
            return _answers[key]
    found = watching.first_of_rows(engine, study.id, rows=rows)
    factors = list(study.plan.distributions)
    there = [row for row in range(rows) if row in found]
    answer = json.dumps(
        {
            "rows": len(there),
            "of": study.plan.rows,
            "factors": factors,
            "output": output,
            "columns": {
                name: [_short(point(study, row, 0)[name]) for row in there] for name in factors
            }
            | {output: [_short((found[row][1] or {}).get(output)) for row in there]},
            "outcomes": [found[row][0] for row in there],
            "row": there,
        }
    ).encode()
    with _lock:
        _answers[key] = answer
        while len(_answers) > MOST_KEPT:
            _answers.popitem(last=False)
    return answer


def _short(value: float | None) -> float | None:
    """Return a number with six digits: more than a screen shows."""
    return None if value is None else float(f"{value:.6g}")
