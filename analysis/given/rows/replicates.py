"""Rows that repeat one point: their outputs differ by noise alone, and they are no new draws.

A stochastic model is run, and a measurement is made, several times at the same point. Taken for
rows that were drawn, they make intervals too narrow and idle factors look influential. So outputs
are averaged at every point (Hurlbert 1984, Pseudoreplication and the design of ecological field
experiments). Points that meet because factors have few values are draws, and stay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage

from analysis.given.measures.rbd_fast import FEW_VALUES
from analysis.given.rows import layout
from analysis.given.rows.copies import FEWEST_POINTS, FEWEST_ROWS, beyond_chance, earlier, numbered
from analysis.given.rows.sample import Sample
from analysis.given.rows.spread import joined

Array = NDArray[np.float64]

#: Rows of which all distances are looked at, at most: they grow with the square.
_MOST_ROWS = 4000
#: Rows are nearly equal if an order of magnitude lies between the usual distances within groups
#: and between them, and no distance is between the two: of drawn points each is followed by another
#: nearly as long.
_ORDER, _GAP = 10.0, 2.0
#: Share of the rows that groups of nearly equal ones hold, at least.
_SHARE = 0.25


@dataclass(frozen=True, kw_only=True)
class Points:
    """A sample point by point."""

    #: A row a point, in the order in which points come first, with its mean outputs.
    sample: Sample
    remarks: Sequence[str]


def at_points(sample: Sample) -> Points:
    """Return a sample with one row for all those that repeat a point."""
    there = np.flatnonzero(np.isfinite(sample.x).all(axis=1))
    point, near = _repeated(sample.x[there])
    points = int(point.max(initial=-1)) + 1
    if points == len(there):
        return Points(sample=sample, remarks=[])
    whole = np.full(len(sample.x), -1)
    whole[there] = point
    alone = whole < 0
    whole[alone] = points + np.arange(alone.sum())
    _, first, code = np.unique(whole, return_index=True, return_inverse=True)
    kept = np.sort(first)
    y = np.transpose([_means(code, column) for column in sample.y.T])[np.argsort(first)]
    averaged = replace(sample, x=sample.x[kept], y=y)
    design = layout.recognise(averaged.x)
    if layout.recognise(sample.x) and not design:
        # Points of a design meet, and its indices need every one of them.
        return Points(sample=sample, remarks=[])
    if design and len(set(np.bincount(code))) > 1:
        return _of_a_part(sample, kept[design.independent])
    rows = int(sample.complete.sum())
    points = int(averaged.complete.sum())
    alike = "nearly equal" if near else "equal"
    said = (
        f"The {rows:,} rows stand at {points:,} points: rows with {alike} factors repeat one, as "
        "of a stochastic model or of repeated measurements, and are no draws of their own. "
    )
    if points < FEWEST_ROWS:
        said += (
            f"Of fewer than {FEWEST_ROWS} points rows are taken as they are: if the points were "
            "drawn, intervals are too narrow and p-values too small."
        )
        return Points(sample=sample, remarks=[said])
    said += (
        "Outputs are averaged at each point, and indices are those of this mean: what moves the "
        "spread of repeats alone they do not show. "
    )
    shares = [_share_of_means(code[sample.complete], one) for one in sample.y[sample.complete].T]
    shown = ", ".join(
        f"{name} times {share:.2g}" for name, share in zip(sample.outputs, shares, strict=True)
    )
    said += f"Shares of the variance of single rows, noise included, are those of {shown}."
    return Points(sample=averaged, remarks=[said])


def _of_a_part(sample: Sample, apart: NDArray[np.intp]) -> Points:
    """Return a sample without the rows that repeat a point where a design moves another factor.

    Args:
        apart: the rows that share no value.
    """
    said = (
        "Rows repeat points as those of a Saltelli or Morris design do of which the table lacks a "
        "factor, and are no draws of their own. "
    )
    apart = np.sort(apart)
    if sample.complete[apart].sum() < FEWEST_ROWS:
        return Points(sample=sample, remarks=[said + "Intervals are too narrow."])
    return Points(
        sample=replace(sample, x=sample.x[apart], y=sample.y[apart]),
        remarks=[
            f"{said}Only the {len(apart):,} rows that share no value are used. Give every factor."
        ],
    )


def _repeated(x: Array) -> tuple[NDArray[np.intp], bool]:
    """Return the number of each row's point, and whether rows of one are only nearly equal."""
    row = numbered(x)
    count = np.bincount(row)
    if len(count) == len(x):
        return _nearly(x)
    if _crossed(x, row):
        return np.arange(len(x)), False
    times = int(np.gcd.reduce(count)) if len(count) >= FEWEST_POINTS else 1
    if times == 1 and not _beyond_chance(x, row):
        return _nearly(x)
    # Where every point stands there so often, those that chance makes equal are dealt their share.
    drawn = count // times if times > 1 else np.ones_like(count)
    first = np.cumsum(drawn) - drawn
    return first[row] + earlier(row) % drawn[row], False


def _nearly(x: Array) -> tuple[NDArray[np.intp], bool]:
    found = _groups(x)
    return (np.arange(len(x)), False) if found is None else (found, True)


def _beyond_chance(x: Array, row: NDArray[np.intp]) -> bool:
    """Say whether more rows are equal than of points drawn from these values.

    Of one factor, or of factors that all depend on each other, it cannot be told: values may be
    rounded.
    """
    once = np.unique(row, return_index=True)[1]
    levels = np.column_stack([numbered(column[:, None]) for column in x.T])
    return beyond_chance(levels, np.bincount(row), joined(levels[once]))


def _crossed(x: Array, row: NDArray[np.intp]) -> bool:
    """Say whether points are all combinations of few values, each of which repeats by design."""
    values = [len(np.unique(column)) for column in x.T]
    whole = float(np.prod(values, dtype=float))
    return bool(row.max() + 1 == whole) and (x.shape[1] > 1 or values[0] <= FEW_VALUES)


def _groups(x: Array) -> NDArray[np.intp] | None:
    """Return the group of nearly equal rows that each row is in; None if there are no such groups.

    By single linkage (Gower and Ross 1969, Minimum spanning trees and single linkage cluster
    analysis), whose joins are many short ones and many long ones then, and none between.
    """
    if not 2 * FEWEST_POINTS <= len(x) <= _MOST_ROWS:
        return None
    spread = x.std(axis=0)
    x = x[:, spread > 0.0] / spread[spread > 0.0]
    tree = linkage(x, "single")
    length = tree[:, 2]
    # Rows that are equal by chance are at no distance from each other.
    apart = int((length <= 0.0).sum())
    least = apart + int(_SHARE * 0.5 * len(x))
    ratio = length[least + 1 : 1 - FEWEST_POINTS] / length[least:-FEWEST_POINTS]
    if not len(ratio) or ratio.max() < _GAP:
        return None
    last = least + int(np.argmax(ratio))
    within, between = length[apart : last + 1], length[last + 1 :]
    if np.median(between) < _ORDER * np.median(within):
        return None
    group = fcluster(tree, (within[-1] + between[0]) / 2.0, "distance") - 1
    order = np.argsort(group, kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(group[order]) > 0])
    extent = np.maximum.reduceat(x[order], start) - np.minimum.reduceat(x[order], start)
    # Where rows are close in a chain only, a factor varies along it.
    if np.linalg.norm(extent, axis=1).max() > between[0]:
        return None
    size = np.bincount(group)
    many = size[size > 1]
    return group if len(many) >= FEWEST_POINTS and many.sum() >= _SHARE * len(x) else None


def _means(code: NDArray[np.intp], y: Array) -> Array:
    """Return an output's mean at each point, of the rows that have it; nan where none has."""
    there = ~np.isnan(y)
    count = np.bincount(code, there)
    total = np.bincount(code, np.where(there, y, 0.0))
    with np.errstate(invalid="ignore"):
        found: Array = total / np.where(count > 0, count, np.nan)
    return found


def _share_of_means(code: NDArray[np.intp], y: Array) -> float:
    """Return the variance of points' means as a share of that of single rows (Fisher 1925)."""
    code = np.unique(code, return_inverse=True)[1]
    count, mean = np.bincount(code), _means(code, y)
    between = float(mean.var(ddof=1))
    within = float(np.sum((y - mean[code]) ** 2)) / max(len(y) - len(count), 1)
    whole = between + within * (1.0 - float(np.mean(1.0 / count)))
    return between / whole if whole > 0.0 else 1.0
