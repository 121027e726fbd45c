"""What can be told of a sample, as JSON; the same table gives the same answer."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.given.doubts import contradictions
from analysis.given.doubts.itself import itself
from analysis.given.doubts.left_over import unexplained
from analysis.given.doubts.tails import on_few_rows
from analysis.given.doubts.waves import missed
from analysis.given.measures.hsic import hsic
from analysis.given.measures.measure import MEASURES, Measure, standard
from analysis.given.rows import layout
from analysis.given.rows.clusters import clustered
from analysis.given.rows.copies import without_copies
from analysis.given.rows.dependence import dependence
from analysis.given.rows.order import rest_in_order
from analysis.given.rows.replicates import at_points
from analysis.given.rows.sample import Sample, choose
from analysis.given.rows.spread import quasi_random
from analysis.given.rows.used import used
from analysis.given.rows.walks import one_line_off
from analysis.given.table.reading import read_sheet
from analysis.json_values import number
from analysis.sensitivity.estimators import Estimate
from analysis.sensitivity.judgement.trust import FEWEST_ROWS as FEWEST_BELIEVED
from analysis.sensitivity.judgement.trust import in_last_digits, not_in_numbers

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
        outputs, factors: names of columns, as `analysis.given.rows.sample.choose`.

    Returns:
        {"file", "rows", "rows_used", "points", "level", "factors": [NAME], "remarks": [SENTENCE],
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
    points = at_points(sample)
    rows = used(points.sample)
    x, y = rows.x, rows.y
    remarks = [*sample.remarks, *points.remarks, *rows.remarks]
    depending: list[str] = []
    clusters: list[str] = []
    tied: set[str] = set()
    if len(x):
        # Several runs at the same point are one of the points that were drawn.
        once = x[without_copies(x, x[:, :0])]
        found = dependence(sample.factors, once, drawn=rows.drawn)
        depending = found.remarks
        tied = {sample.factors[f] for pair in found.pairs for f in pair}
        remarks += [*depending, _few_rows(len(x), rows.design)]
        if rows.drawn and rows.design is None:
            clusters = clustered(once, found.pairs)
            remarks += clusters
    withheld = _withheld_from(x, sample.factors)
    remarks += [*_few_values(x, sample.factors), *(why for _, why in withheld)]
    measures = MEASURES if len(x) else ()
    of_samples = {
        name: {
            m.name: _untold(sample.factors)
            if any(m.name in names for names, _ in withheld)
            else _of_sample(m, x, y[:, o], sample.factors)
            for m in measures
        }
        for o, name in enumerate(sample.outputs)
    }
    remarks += [
        f"delta of {name} is not told, or without an interval: its tail is too heavy for a "
        "density between its extremes; give its logarithm or its ranks."
        for name, told in of_samples.items()
        if any(None in (one["value"], one["low"]) for one in told.get("delta", {}).values())
    ]
    few = {
        name: on_few_rows(name, y[:, o], sample.factors, x) if len(x) else ""
        for o, name in enumerate(sample.outputs)
    }
    if len(x):
        remarks += few.values()
        for o, name in enumerate(sample.outputs):
            near = found.pairs if rows.drawn else None
            remarks += itself(name, y[:, o], sample.factors, x, near)
    # Rows that share values of others, or lie evenly, are alike for that.
    if len(x) and rows.drawn and not any("rbd_fast" in names for names, _ in withheld):
        for o, name in enumerate(sample.outputs):
            waves = missed(name, y[:, o], sample.factors, x)
            remarks += waves.values()
            # Where few rows make up the variance, or rows lie in clusters, the reason is known.
            if not (clusters or few[name]):
                told = contradictions.shares(of_samples[name])
                remarks += contradictions.apart(name, told, LEVEL, tied=tied, known=waves)
            remarks += rest_in_order(name, y[rows.order, o], sample.factors, x[rows.order])
    # A Saltelli design has total-order indices.
    if len(x) and rows.drawn and (rows.design is None or rows.design.method == "morris"):
        for o, name in enumerate(sample.outputs):
            told = contradictions.shares(of_samples[name])
            remarks += unexplained(
                name, y[:, o], sample.factors, x, told, designed=rows.design is not None
            )
    for name, own in zip(sample.outputs, sample.y.T, strict=True):
        ends = float(np.nanmin(own)), float(np.nanmax(own))
        lost = [*not_in_numbers(name, *ends), *in_last_digits(name, *ends)]
        remarks += [f"Do not trust these intervals: {why}." for why in lost]
    design, complete = rows.design, sample.complete
    designed = (
        {} if design is None else layout.indices(design, points.sample.x, points.sample.y, LEVEL)
    )
    by_design = {
        name: _of_design(designed, o, sample.factors) for o, name in enumerate(sample.outputs)
    }
    for o, name in enumerate(sample.outputs):
        remarks += one_line_off(name, design, points.sample.x, points.sample.y[:, o])
    for name, of_design in by_design.items():
        told, first = contradictions.shares(of_samples[name]), of_design.get("first_order", {})
        independent = {"the design's S": first} if first else {}
        independent |= told if first or not depending else {}
        remarks += contradictions.beyond_the_whole(name, independent, LEVEL)
        remarks += contradictions.out_of_range(name, told, LEVEL)
        remarks += contradictions.two_answers(name, first, told, LEVEL)
    return {
        "file": sample.file,
        "rows": len(sample.x),
        "rows_used": int(complete.sum()),
        "points": int(points.sample.complete.sum()),
        "level": LEVEL,
        "factors": list(sample.factors),
        "design": design
        and {"method": design.method, "rows": len(design.places), "width": design.places.shape[1]},
        "measures": {
            measure.name: {
                "symbol": measure.symbol,
                "assumes": measure.assumes,
                "source": measure.source,
                "rows": measure.looks_at(*x.shape),
            }
            for measure in measures
        },
        "outputs": {
            name: {
                "mean": number(sample.y[complete, o].mean()),
                "sd": number(sample.y[complete, o].std(ddof=1)),
                "design": by_design[name],
                "measures": of_samples[name],
            }
            for o, name in enumerate(sample.outputs)
        },
        "remarks": [remark for remark in remarks if remark],
    }


def _few_rows(rows: int, design: layout.Layout | None) -> str:
    """Return the remark on intervals of few rows, unless that on a design says so, or nothing."""
    if rows >= FEWEST_BELIEVED or (design and len(design.places) < FEWEST_BELIEVED):
        return ""
    return (
        f"Intervals of fewer than {FEWEST_BELIEVED} rows, such as these {rows}, are not to be "
        "believed."
    )


def _few_values(x: Array, factors: Sequence[str]) -> list[str]:
    """Return the remark on factors that look like levels, if there are any."""
    levels = {name: len(np.unique(x[:, f])) for f, name in enumerate(factors)}
    # Of two no order means anything.
    few = [f"{name} ({count})" for name, count in levels.items() if 2 < count <= 10]
    if not few:
        return []
    return [f"Factors of few values, whose order is taken to mean something: {', '.join(few)}."]


def _withheld_from(x: Array, factors: Sequence[str]) -> list[tuple[Sequence[str], str]]:
    """Return names of measures that these rows cannot tell, with a remark that says why."""
    found: list[tuple[Sequence[str], str]] = []
    if len(x) and quasi_random(x):
        names = [measure.name for measure in MEASURES if measure.needs_drawn]
        why = (
            "The points lie more evenly than random ones, as those of Sobol's or Halton's "
            "sequences do, or of a Latin hypercube that was optimised: "
            f"{', '.join(names)} is withheld, for in points of a sequence the other factors' waves "
            "look like those of the factor itself. See delta, pawn and hsic."
        )
        found.append((names, why))
    for measure in MEASURES:
        fewest = measure.fewest_rows(len(factors))
        if 0 < len(x) < fewest:
            why = f"{measure.name} is withheld: of {len(factors)} factors it takes {fewest} rows."
            found.append(([measure.name], why))
    return found


def _of_sample(measure: Measure, x: Array, y: Array, factors: Sequence[str]) -> dict[str, Any]:
    """Return a measure of every factor."""
    rng = np.random.default_rng(1)
    rows = measure.looks_at(*x.shape)
    x, y = x[:rows], y[:rows]
    if np.ptp(y) == 0.0:
        return {}
    found = measure.estimate(x, y, LEVEL, rng)
    columns = {"value": found.value, "low": found.low, "high": found.high}
    if measure.biased:
        columns["chance"] = found.chance
    if measure.name == "hsic":
        columns["p_value"] = hsic(standard(x), standard(y)).p_value
    return {
        factor: {name: number(column[f]) for name, column in columns.items()}
        for f, factor in enumerate(factors)
    }


def _untold(factors: Sequence[str]) -> dict[str, Any]:
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
