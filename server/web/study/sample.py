"""Some runs of a study, from which a page draws distributions, scatter plots and pairs.

However large a study is, these are of its first rows, whose points fill the factor space evenly as
all of them do; they are looked for again when the rows have doubled, so an open page costs little.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy.engine import Engine

from analysis.reports import figures
from analysis.reports.figures.shared import plain
from analysis.reports.wording import words
from server.logic.study.points import parameters
from server.operations import watching
from server.records import Study
from server.web.cache import Cache

#: Rows that are looked at; of each the first point, which is independent of the other rows'.
MOST_ROWS = 1024
POINTS: Cache[dict[str, float]] = Cache(10_000)
ANSWERS: Cache[bytes] = Cache(48)


def version(study: Study) -> tuple[int, int]:
    """Return what changes when there is more to see: the edition, and the rows in powers of two."""
    complete = min(study.rows_complete, MOST_ROWS)
    whole = complete if complete == study.plan.rows else 1 << complete.bit_length() >> 1
    return study.edition, whole


def point(study: Study, row: int, position: int) -> dict[str, float]:
    """Return the factors of a run; most are asked for again with every look."""

    def found() -> dict[str, float]:
        every = parameters(study.plan, row)[position]
        return {name: every[name] for name in study.plan.distributions}

    return POINTS.of((study.id, study.edition, row, position), found)


def shown(
    engine: Engine, study: Study, output: str, factor: str, other: str, units: Mapping[str, str]
) -> bytes:
    """Return figures of the runs as JSON.

    Args:
        output: what they are of.
        factor, other: the two that are drawn; the first ones for names that the study lacks.
        units: of factors and outputs by name.

    Returns:
        {"rows", "of", "factors", "factor", "other", "table", "figures": by name}.
    """
    edition, rows = version(study)
    factors = list(study.plan.distributions)
    x = factor if factor in factors else next((n for n in factors if n != other), factors[0])
    y = other if other in factors else next((n for n in factors if n != x), x)

    def found() -> bytes:
        runs = _Runs.of(engine, study, output, rows)
        return json.dumps(
            {
                "rows": len(runs.row),
                "of": study.plan.rows,
                "factors": factors,
                "factor": x,
                "other": y,
                "table": runs.table(output),
                "figures": runs.figures(output, x, y, units) if runs.row else {},
            }
        ).encode()

    return ANSWERS.of((study.id, edition, rows, output, x, y), found)


@dataclass(frozen=True, kw_only=True)
class _Runs:
    """Runs that are there: where, what came of them, their factors (n, factors), their output."""

    factors: list[str]
    row: list[int]
    outcome: list[str]
    points: NDArray[np.float64]
    #: NaN where there is none.
    values: NDArray[np.float64]

    @classmethod
    def of(cls, engine: Engine, study: Study, output: str, rows: int) -> "_Runs":
        found = watching.first_of_rows(engine, study.id, rows=rows)
        there = [row for row in range(rows) if row in found]
        factors = list(study.plan.distributions)
        said = [(found[row][1] or {}).get(output) for row in there]
        points = [[point(study, row, 0)[name] for name in factors] for row in there]
        return cls(
            factors=factors,
            row=there,
            outcome=[found[row][0] for row in there],
            points=np.array(points, dtype=float).reshape(len(there), len(factors)),
            # Of a curve no run has one number.
            values=np.array([v if isinstance(v, int | float) else np.nan for v in said]),
        )

    def table(self, output: str) -> dict[str, Any]:
        """Return them as a table, with six digits: more than a screen shows."""
        numbers = np.column_stack([self.points, self.values]).tolist()
        return {
            "head": ["row", "outcome", *self.factors, output],
            "rows": [
                [row, outcome, *(None if v != v else float(f"{v:.6g}") for v in line)]
                for row, outcome, line in zip(self.row, self.outcome, numbers, strict=True)
            ],
        }

    def figures(
        self, output: str, x: str, y: str, units: Mapping[str, str]
    ) -> dict[str, figures.Figure]:
        """Return what is drawn of them; those that failed glow."""
        good = np.isfinite(self.values)
        bad = np.array([outcome != "ok" for outcome in self.outcome], dtype=bool)
        i, j = self.factors.index(x), self.factors.index(y)
        told = [
            f"row {row}<br>{plain(words(x))} {line[i]:.4g}<br>{plain(words(y))} {line[j]:.4g}<br>"
            f"{plain(words(output))} {f'{value:.4g}' if value == value else plain(words(outcome))}"
            for row, outcome, line, value in zip(
                self.row, self.outcome, self.points, self.values, strict=True
            )
        ]
        values = self.values[good]
        say: dict[str, Any] = {
            "told": [text for text, shown in zip(told, good, strict=True) if shown],
            "of_failed": [text for text, shown in zip(told, bad, strict=True) if shown],
        }
        unit, named = units.get(output, ""), ((x, units.get(x, "")), (y, units.get(y, "")))
        drawn = {
            "scatter": figures.against(
                *(self.points[good, i], values, x, output, unit, units.get(x, "")),
                failed=self.points[bad, i],
                **say,
            ),
            "distribution": figures.distribution(values, output, unit),
            "pair": figures.pair(
                *(self.points[good][:, [i, j]], values, named, (output, unit)),
                failed=self.points[bad][:, [i, j]],
                **say,
            ),
            "parallel": figures.parallel(self.points[good], values, self.factors, output),
        }
        for name in ("scatter", "distribution", "pair"):
            # They stand beside each other.
            drawn[name]["layout"]["height"] = 350
        return drawn
