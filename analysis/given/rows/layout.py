"""Whether a sample is a design of Saltelli et al. 2010 or Morris 1991, and its indices then.

Their rows are told by their points alone: A_B^(i) differs from A in one column, where it has B's
value; a step of Morris's moves one factor. So it does not matter which program made them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.designs.radial import legs
from analysis.sensitivity.estimators import Estimate, Estimator, MorrisEstimator, estimator_class
from analysis.sensitivity.estimators.weightings import FIRST, WEIGHTINGS
from analysis.sensitivity.judgement.trust import FEWEST_ROWS as FEWEST_BELIEVED

Array = NDArray[np.float64]

#: Rows of a design that must be there for a sample to be taken for one.
FEWEST = 4
#: Of rows that do not fit, the share with which a sample is one still: of drawn rows hardly any
#: fits, and a design that lost more is better given anew. And how many are shown.
_DAMAGED, _SHOWN = 0.1, 5
#: The blocks of rows are dealt at random: of what another program drew nothing else is known.
_SAMPLING = "latin_hypercube"


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A design that a sample is."""

    #: One of `analysis.designs.METHODS`.
    method: str
    #: Where each point of each row is in the sample, in the order of our own designs, shape (rows,
    #: width).
    places: NDArray[np.intp]
    #: Where the first runs of rows are that are damaged, which are left out.
    damaged: Sequence[int] = ()

    @property
    def independent(self) -> NDArray[np.intp]:
        """Places of points that do not share a coordinate by design: A and B, or bases."""
        kept: NDArray[np.intp] = self.places[:, : 1 if self.method == "morris" else 2].T.ravel()
        return kept

    @property
    def sentence(self) -> str:
        """What it is, in words."""
        kind = "a Morris design" if self.method == "morris" else "a Saltelli design"
        if self.method == "saltelli_second_order":
            kind += " with pairs"
        rows, width = self.places.shape
        said = f"The sample is {kind} of {rows} rows of {width} runs, and is analysed as one too."
        if rows < FEWEST_BELIEVED:
            said += f" Intervals of fewer than {FEWEST_BELIEVED} rows are not to be believed."
        if self.damaged:
            shown = ", ".join(f"{place + 1:,}" for place in self.damaged[:_SHOWN])
            said += (
                f" {len(self.damaged)} of its rows, which begin in row {shown}"
                + (" and so on" if len(self.damaged) > _SHOWN else "")
                + " of the table, do not fit the others and are left out: look at their factors."
            )
        return said


def recognise(x: Array) -> Layout | None:
    """Return which design a sample is, in the order of its rows; None if it is no such.

    Known are rows of our own, of SALib (A, the A_B^(i), B) and of designs block by block (all A,
    all B, all A_B^(1), ...; OpenTURNS); radial rows and trajectories (Morris 1991; Campolongo et
    al. 2011).
    """
    runs, k = x.shape
    if k < 2:
        return None
    for method, width in (("saltelli_second_order", 2 * k + 2), ("saltelli", k + 2)):
        if runs % width or runs // width < FEWEST:
            continue
        for places in _orders(runs // width, k, second_order=width > k + 2):
            if found := _with(method, x, places, _fits_saltelli(x[places], k)):
                return found
    if runs % (k + 1) == 0 and runs // (k + 1) >= FEWEST:
        places = np.arange(runs).reshape(-1, k + 1)
        return _with("morris", x, places, _fits_morris(x[places]))
    return None


def _with(
    method: str, x: Array, places: NDArray[np.intp], fits: NDArray[np.bool_]
) -> Layout | None:
    """Return the design of the rows that fit, if it is hardly fewer than all."""
    fits &= np.isfinite(x[places]).all(axis=(1, 2))
    # Rows of one point fit whatever they are, as of events that are rare.
    varied = (x[places] != x[places[:, :1]]).any(axis=(1, 2))
    if fits.sum() < FEWEST or fits[varied].sum() < max(1.0, (1.0 - _DAMAGED) * varied.sum()):
        return None
    # Block by block the runs of a row are far apart.
    first = np.sort(places[~fits].min(axis=1, initial=places.size))
    return Layout(method=method, places=places[fits], damaged=first.tolist())


def indices(layout: Layout, x: Array, y: Array, level: float) -> dict[str, Estimate]:
    """Return the indices of a design (`analysis.sensitivity.estimators`), shape (outputs, ...).

    Effects are per range of the factor in the sample.

    Args:
        x, y: of the whole sample, shape (runs, factors) and (runs, outputs), nan where a run has no
            output.
    """
    # Replicates take most of the time, and few rows or heavy tails alone need them.
    found = _indices(layout, x, y, level, FIRST)
    if any(np.isnan(one.low[~np.isnan(one.value)]).any() for one in found.values()):
        found = _indices(layout, x, y, level, WEIGHTINGS)
    return found


def _indices(
    layout: Layout, x: Array, y: Array, level: float, weightings: int
) -> dict[str, Estimate]:
    estimator: Estimator
    if layout.method == "morris":
        used = x[layout.places]
        low, high = used.min(axis=(0, 1)), used.max(axis=(0, 1))
        points = (used - low) / (high - low)
        estimator = _Given(points, outputs=y.shape[1], weightings=weightings)
    else:
        estimator = estimator_class(layout.method)(
            sampling=_SAMPLING,
            seed=0,
            factors=x.shape[1],
            outputs=y.shape[1],
            weightings=weightings,
        )
    estimator.add_rows(range(len(layout.places)), y[layout.places])
    return estimator.indices(level)


class _Given(MorrisEstimator):
    """Elementary effects of points that are no function of a seed."""

    def __init__(self, points: Array, *, outputs: int, weightings: int) -> None:
        factors = points.shape[-1]
        super().__init__(
            sampling=_SAMPLING, seed=0, factors=factors, outputs=outputs, weightings=weightings
        )
        self._points = points

    def _designed(self, rows: Sequence[int]) -> Array:
        return self._points[list(rows)]


def _orders(rows: int, k: int, *, second_order: bool) -> list[NDArray[np.intp]]:
    """Return where A, B, the A_B^(i) and the B_A^(i) may be."""
    width = 2 * k + 2 if second_order else k + 2
    by_row = np.arange(rows * width).reshape(rows, width)
    by_block = np.arange(rows * width).reshape(width, rows).T
    salib = [0, width - 1, *range(1, width - 1)]
    return [by_row, by_row[:, salib], by_block]


def _fits_saltelli(points: Array, k: int) -> NDArray[np.bool_]:
    """Return which rows of (rows, width, k) are A, B, A_B^(i) and perhaps B_A^(i)."""
    a, b = points[:, 0], points[:, 1]
    fits = np.full(len(points), not (a == b).all())
    for start, base, other in ((2, a, b), (2 + k, b, a))[: 1 + (points.shape[1] > k + 2)]:
        for i in range(k):
            mixed = base.copy()
            mixed[:, i] = other[:, i]
            fits &= (points[:, start + i] == mixed).all(axis=1)
    return fits


def _fits_morris(points: Array) -> NDArray[np.bool_]:
    """Return in which of rows (rows, k + 1, k) every factor is moved once, alone."""
    k = points.shape[-1]
    (before, after), step = legs(points)
    row = np.arange(len(points))[:, None]
    moved = points[row, before] != points[row, after]
    fits = np.array([len(set(places)) == k for places in after.tolist()])
    fits &= (moved.sum(axis=-1) == 1).all(axis=1) & (step != 0.0).all(axis=1)
    return fits
