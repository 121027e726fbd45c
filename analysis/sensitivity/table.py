"""A study's results as a table of numbers, one line per run."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.designs import family, row_width
from analysis.sensitivity.records import LoggedResult, StudyPlan


@dataclass(frozen=True, kw_only=True)
class Table:
    """Results of a study, one per line."""

    plan: StudyPlan
    rows: NDArray[np.int64]
    positions: NDArray[np.int64]
    outcomes: tuple[str, ...]
    #: Factor values in the factors' units, shape (lines, factors).
    points: NDArray[np.float64]
    #: Outputs, shape (lines, outputs); nan where a run failed.
    values: NDArray[np.float64]

    def results(self) -> Iterator[LoggedResult]:
        """Yield the lines as the analysis takes them, numbered in this order."""
        for line, (row, position, outcome) in enumerate(
            zip(self.rows.tolist(), self.positions.tolist(), self.outcomes, strict=True)
        ):
            found = dict(zip(self.plan.outputs, self.values[line].tolist(), strict=True))
            yield LoggedResult(
                seq=line + 1,
                instance=f"{self.plan.id}:{row}:{position}",
                row=row,
                position=position,
                outcome=outcome,
                outputs=found if outcome == "ok" else {},
            )

    def by_row(self, output: str) -> NDArray[np.float64]:
        """Return an output's values at A, B and A_B^(i), shape (rows, factors + 2).

        Of a variance-based study (Saltelli et al. 2010); nan where no value came.
        """
        o, factors = self.plan.outputs.index(output), len(self.plan.units)
        rows = np.full((self.plan.rows, row_width(self.plan.method, factors)), np.nan)
        rows[self.rows, self.positions] = self.values[:, o]
        return rows[:, : factors + 2]

    def sample(self, output: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points and values of one output that stand for the factors' distributions.

        Returns:
            Shapes (n, factors) and (n,), those of `sampled`.
        """
        lines = self.sampled(output)
        return self.points[lines], self.values[lines, self.plan.outputs.index(output)]

    def sampled(self, output: str) -> NDArray[np.intp]:
        """Return the lines whose points stand for the factors' distributions, without failed runs.

        Of a study of shares these are A and B, which are independent draws; of a screening all
        points, each of which is such a draw, though those of a row are related.
        """
        values = self.values[:, self.plan.outputs.index(output)]
        keep = np.isfinite(values)
        if family(self.plan.method) != "morris":
            keep &= self.positions < 2
        return np.flatnonzero(keep)
