"""A study's results as a table of numbers, read from the CSV file that the coordinator writes."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.designs import family
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

    @classmethod
    def read(cls, plan: StudyPlan, path: Path) -> "Table":
        """Read a study's `results.csv`.

        Raises:
            ValueError: the file is no table of this study.
        """
        rows, positions, outcomes = list[int](), list[int](), list[str]()
        points, values = list[list[float]](), list[list[float]]()
        with path.open(newline="") as file:
            lines = csv.DictReader(file)
            wanted = {"row", "position", "outcome", *plan.factors, *plan.outputs}
            if missing := sorted(wanted - set(lines.fieldnames or ())):
                raise ValueError(f"{path} is no table of study {plan.id}: no {', '.join(missing)}")
            for line in lines:
                rows.append(int(line["row"]))
                positions.append(int(line["position"]))
                outcomes.append(line["outcome"])
                points.append([float(line[name]) for name in plan.factors])
                values.append([float(line[name] or nan) for name in plan.outputs])
        return cls(
            plan=plan,
            rows=np.array(rows, dtype=np.int64),
            positions=np.array(positions, dtype=np.int64),
            outcomes=tuple(outcomes),
            points=np.array(points, dtype=np.float64).reshape(-1, len(plan.factors)),
            values=np.array(values, dtype=np.float64).reshape(-1, len(plan.outputs)),
        )

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

    def sample(self, output: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points and values of one output that stand for the factors' distributions.

        Returns:
            Shapes (n, factors) and (n,), those of `sampled`.
        """
        lines = self.sampled(output)
        return self.points[lines], self.values[lines, self.plan.outputs.index(output)]

    def sampled(self, output: str) -> NDArray[np.intp]:
        """Return the lines whose points stand for the factors' distributions, without failed runs.

        Of a variance-based study these are A and B, which are independent draws; of a screening all
        points, each of which is such a draw, though those of a row are related.
        """
        values = self.values[:, self.plan.outputs.index(output)]
        keep = np.isfinite(values)
        if family(self.plan.method) == "saltelli":
            keep &= self.positions < 2
        return np.flatnonzero(keep)
