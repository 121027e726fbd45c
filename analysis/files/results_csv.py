"""A study's results as the CSV file that the coordinator writes."""

import csv
from collections.abc import Iterable, Mapping
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.table import Table


def columns(factors: Iterable[str], outputs: Iterable[str]) -> list[str]:
    """Return the names of the columns of a study's table."""
    return ["row", "position", *factors, "outcome", *outputs, "wall_seconds", "worker"]


def read_table(plan: StudyPlan, path: Path) -> Table:
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
        try:
            for line in lines:
                rows.append(int(line["row"]))
                positions.append(int(line["position"]))
                outcomes.append(line["outcome"])
                points.append([float(line[name]) for name in plan.factors])
                values.append([float(line[name] or nan) for name in plan.outputs])
        except (ValueError, TypeError):
            raise ValueError(f"line {lines.line_num}: {_no_number(line, plan)}") from None
    return Table(
        plan=plan,
        rows=np.array(rows, dtype=np.int64),
        positions=np.array(positions, dtype=np.int64),
        outcomes=tuple(outcomes),
        points=np.array(points, dtype=np.float64).reshape(-1, len(plan.factors)),
        values=np.array(values, dtype=np.float64).reshape(-1, len(plan.outputs)),
    )


def _no_number(line: Mapping[str, Any], plan: StudyPlan) -> str:
    """Say which cell of a line is none of the numbers that belong there."""
    read = {"row": int, "position": int, **dict.fromkeys(plan.factors, float)}
    for name, kind in (read | dict.fromkeys(plan.outputs, float)).items():
        text = line[name]
        try:
            kind(text if name in read else text or nan)
        except (ValueError, TypeError):
            what = "whole number" if kind is int else "number"
            return f"{name} must be a {what}, not {'missing' if text is None else repr(text[:60])}"
    return "it cannot be read"
