"""What can be told of a sample, as JSON; the same table gives the same answer."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.given import layout
from analysis.given.dependence import related
from analysis.given.hsic import hsic
from analysis.given.measures import MEASURES, Measure
from analysis.given.reading import read_sheet
from analysis.given.sample import FEWEST_ROWS, Sample, choose, first_of_each
from analysis.given.spread import in_parts, quasi_random, sharing_nothing
from analysis.json_values import number
from analysis.sensitivity.estimators import Estimate

Array = NDArray[np.float64]

#: Of all intervals.
LEVEL = 0.9


def analyse(
    path: Path, outputs: Sequence[str] = (), factors: Sequence[str] | None = None
) -> dict[str, Any]:
    """Return what a file's rows tell of its factors.

    Sources: each measure's `source`, Saltelli et al. 2010, Campolongo et al. 2011.

    Args:
        path: CSV or Parquet.
        outputs, factors: names of columns, as `analysis.given.sample.choose`.

    Returns:
        {"file", "rows", "rows_used", "level", "factors": [NAME], "remarks": [SENTENCE],
        "design": None or {"method", "rows", "width"}, "measures": {MEASURE: {"symbol", "assumes",
        "source", "rows"}}, "outputs": {NAME: {"mean", "sd", "design": {INDEX: INTERVALS},
        "measures": {MEASURE: {FACTOR: {"value", "low", "high"} and "chance" of a biased one and
        "p_value" of hsic}}}}}; None is a number that is not told, for the reason in "remarks".

    Raises:
        GivenError: the file cannot be analysed.
        ModuleNotFoundError: a package of the extra `given` is missing.
        OSError: it cannot be read.
    """
    return answer(choose(read_sheet(path), outputs, factors))


def answer(sample: Sample) -> dict[str, Any]:
    """Return `analyse` of a sample that was read."""
    remarks = list(sample.remarks)
    whole = np.isfinite(sample.x).all()
    found = layout.recognise(sample.x) if whole else None
    complete = sample.complete
    rows = np.flatnonzero(complete)
    drawn = True
    if found is not None:
        remarks.append(found.sentence)
        rows = found.independent[complete[found.independent]]
        if len(rows) < FEWEST_ROWS:
            remarks.append(
                f"Only {len(rows)} of its runs share no value by design, and {FEWEST_ROWS} are "
                "needed for the indices of samples: those of the design are all there is."
            )
            rows = rows[:0]
    elif parts := in_parts(sample.x[rows]):
        apart = sharing_nothing(sample.x[rows])
        drawn = used = len(apart) >= FEWEST_ROWS
        remarks.append(
            f"{parts} of {len(rows)} rows differ from another in one factor only, as parts of a "
            "Saltelli or Morris design do: they are not drawn independently. "
            + (
                f"Only the {len(apart)} rows that share no value are used. "
                if used
                else "Intervals are too narrow. "
            )
            + "If it is a design, give every line of it, in its order."
        )
        rows = rows[apart] if used else rows
    x, y = sample.x[rows], sample.y[rows]
    # Rows may come sorted by a factor, and equal values would then stay sorted.
    order = np.random.default_rng(0).permutation(len(rows))
    x, y = x[order], y[order]
    if len(rows):
        # Several runs at the same point are one of the points that were drawn.
        points = x[first_of_each(x, x.shape[1])]
        remarks.extend(related(sample.factors, points, drawn=drawn))
    levels = {name: len(np.unique(x[:, f])) for f, name in enumerate(sample.factors)}
    if few := [f"{name} ({count})" for name, count in levels.items() if 0 < count <= 10]:
        remarks.append(
            f"Factors of few values, whose order is taken to mean something: {', '.join(few)}."
        )
    withheld: tuple[str, ...] = ()
    if len(rows) and quasi_random(x):
        withheld = tuple(measure.name for measure in MEASURES if measure.needs_drawn)
        remarks.append(
            "The points lie more evenly than random ones, as those of Sobol's or Halton's "
            f"sequences do: {', '.join(withheld)} is withheld, for in such points the other "
            "factors' waves look like those of the factor itself. See delta, pawn and hsic."
        )
    short = [m for m in MEASURES if 0 < len(rows) < m.fewest_rows(len(sample.factors))]
    for measure in short:
        withheld += (measure.name,)
        remarks.append(
            f"{measure.name} is withheld: of {len(sample.factors)} factors it takes "
            f"{measure.fewest_rows(len(sample.factors))} rows."
        )
    designed = {} if found is None else layout.indices(found, sample.x, sample.y, LEVEL)
    measures = MEASURES if len(rows) else ()
    of_samples = {
        name: {
            m.name: _withheld(sample.factors)
            if m.name in withheld
            else _of_sample(m, x, y[:, o], sample.factors)
            for m in measures
        }
        for o, name in enumerate(sample.outputs)
    }
    for name, found_of in of_samples.items():
        if any(
            one["value"] is None or one["low"] is None for one in found_of.get("delta", {}).values()
        ):
            remarks.append(
                f"delta of {name} is not told, or without an interval: its tail is too heavy for a "
                "density between its extremes; give its logarithm or its ranks."
            )
    return {
        "file": sample.file,
        "rows": len(sample.x),
        "rows_used": int(complete.sum()),
        "level": LEVEL,
        "factors": list(sample.factors),
        "design": found
        and {"method": found.method, "rows": len(found.places), "width": found.places.shape[1]},
        "measures": {
            measure.name: {
                "symbol": measure.symbol,
                "assumes": measure.assumes,
                "source": measure.source,
                "rows": min(len(rows), measure.most_rows),
            }
            for measure in measures
        },
        "outputs": {
            name: {
                "mean": number(sample.y[complete, o].mean()),
                "sd": number(sample.y[complete, o].std(ddof=1)),
                "design": _of_design(designed, o, sample.factors),
                "measures": of_samples[name],
            }
            for o, name in enumerate(sample.outputs)
        },
        "remarks": remarks,
    }


def _of_sample(measure: Measure, x: Array, y: Array, factors: Sequence[str]) -> dict[str, Any]:
    """Return a measure of every factor."""
    rng = np.random.default_rng(1)
    x, y = x[: measure.most_rows], y[: measure.most_rows]
    if np.ptp(y) == 0.0:
        return {}
    # No measure looks at units; numbers far from 1 may overflow or vanish on the way.
    x, y = ((one - one.mean(axis=0)) / one.std(axis=0) for one in (x, y))
    found = measure.estimate(x, y, LEVEL, rng)
    columns = {"value": found.value, "low": found.low, "high": found.high}
    if measure.biased:
        columns["chance"] = found.chance
    if measure.name == "hsic":
        columns["p_value"] = hsic(x, y).p_value
    return {
        factor: {name: number(column[f]) for name, column in columns.items()}
        for f, factor in enumerate(factors)
    }


def _withheld(factors: Sequence[str]) -> dict[str, Any]:
    """Return a measure of every factor that is not told."""
    return {factor: dict.fromkeys(("value", "low", "high")) for factor in factors}


def _of_design(
    found: Mapping[str, Estimate], output: int, factors: Sequence[str]
) -> dict[str, Any]:
    """Return the indices of single factors that a design gives."""
    return {
        name: {
            factor: {
                end: number(getattr(index, end)[output, f]) for end in ("value", "low", "high")
            }
            for f, factor in enumerate(factors)
        }
        for name, index in found.items()
        if index.value.ndim == 2 and index.value.shape[1] == len(factors) and name != "second_order"
    }
