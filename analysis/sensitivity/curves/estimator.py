"""All sums that the indices of one curve are made of: exact, mergeable, in any order.

At every point they are those of a scalar (`points`). Of the whole curve, generalised indices are
shares of the sum of the points' variances (Lamboni, Monod and Makowski 2011, Multivariate
sensitivity analysis to measure global contribution of input factors in dynamic models; Gamboa,
Janon, Klein and Lagnoux 2014, Sensitivity analysis for multidimensional and functional outputs):
all points count alike. They need no sums of their own but those that tell how heavy their tail is.
Principal components and the indices of their scores are quadratic forms of sums of products of the
curve's coefficients (`basis`).
"""

import io
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analysis.designs import family, unit_rows
from analysis.designs.radial import legs
from analysis.sensitivity.curves.basis import COEFFICIENTS, coefficients, length, products
from analysis.sensitivity.curves.points import REPLICATES, point_estimator
from analysis.sensitivity.estimators.tails import LARGEST_FOURTH
from analysis.sensitivity.estimators.weightings import FIRST, NamedSums, Weighted, weights
from analysis.sensitivity.records import LARGEST_OUTPUT

Array = NDArray[np.float64]

_WEIGHTINGS = FIRST + REPLICATES


class CurveEstimator:
    """Indices of one curve from rows that arrive in any order.

    Args:
        method, sampling, seed: of the design.
        factors, points: how many.
    """

    def __init__(self, *, method: str, sampling: str, seed: int, factors: int, points: int) -> None:
        self.method = method
        self.points = point_estimator(
            method, sampling=sampling, seed=seed, factors=factors, outputs=points
        )
        self.factors = factors
        self.size = min(points, COEFFICIENTS)
        pairs = self.size * (self.size + 1) // 2
        of_scores: dict[str, tuple[int, ...]] = {"score": (self.size,), "score_product": (pairs,)}
        of_factors: dict[str, tuple[int, ...]] = {
            "difference": (factors, self.size),
            "difference_product": (factors, pairs),
        }
        if family(method) == "saltelli":
            of_factors["cross"] = (factors, pairs)
        #: Without replicates, which principal components do without.
        self._components = NamedSums(FIRST, of_scores | of_factors)
        #: Of the lengths of differences, in all weightings and in the sample itself.
        self._lengths = NamedSums(_WEIGHTINGS, {"size": (factors,)})
        self._sample = NamedSums(1, {"root": (factors,), "fourth": (factors,)})

    def add_rows(self, rows: Sequence[int], values: Array) -> None:
        """Take in complete rows.

        Args:
            rows: their numbers in the design.
            values: shape (rows, width, points), nan where a run failed.

        Raises:
            ValueError: the shape of `values` is another.
        """
        self.points.add_rows(rows, values)
        if not rows:
            return
        values = np.where(np.abs(values) <= LARGEST_OUTPUT, values, np.nan)
        weighting = weights(self.points.sampling, self.points.seed, rows)
        terms = self._morris(rows, values) if self.method == "morris" else self._saltelli(values)
        for sums in (self._components, self._lengths, self._sample):
            sums.add(weighting, {name: one for name, one in terms.items() if name in sums.places})

    def merge(self, other: Self) -> None:
        """Add what `other` has seen; ValueError if it belongs to another curve."""
        self.points.merge(other.points)
        self._components.merge(other._components)
        self._lengths.merge(other._lengths)
        self._sample.merge(other._sample)

    def components(self) -> Weighted:
        """Return the sums of products of coefficients, in the sample and without each block."""
        return self._components.weighted(FIRST)

    def lengths(self) -> Weighted:
        """Return the sum "size", the lengths of differences, in all weightings."""
        return self._lengths.weighted(_WEIGHTINGS)

    def lengths_of_sample(self) -> Weighted:
        """Return the sums "root" and "fourth" of the lengths of differences, in the sample."""
        return self._sample.weighted(1)

    def to_bytes(self) -> bytes:
        """Return all that was summed, as an NPZ file without pickles."""
        buffer = io.BytesIO()
        np.savez(
            buffer,
            points=np.frombuffer(self.points.to_bytes(), dtype=np.uint8),
            **self._components.arrays("components"),
            **self._lengths.arrays("lengths"),
            **self._sample.arrays("sample"),
        )
        return buffer.getvalue()

    def load_bytes(self, data: bytes) -> None:
        """Replace what was summed by what `to_bytes` of an equal estimator returned.

        Raises:
            ValueError: the bytes are those of an estimator of other shape.
        """
        with np.load(io.BytesIO(data), allow_pickle=False) as saved:
            self.points.load_bytes(saved["points"].tobytes())
            self._components.load("components", saved)
            self._lengths.load("lengths", saved)
            self._sample.load("sample", saved)

    def _saltelli(self, values: Array) -> dict[str, Array]:
        a, b = values[:, 0], values[:, 1]  # rows, points
        mixed = values[:, 2 : 2 + self.factors]
        score = coefficients(np.stack([a, b]))  # 2, rows, size
        difference = coefficients(mixed) - score[0][:, None]  # rows, factors, size
        cross = products(score[1][:, None], difference)
        return {
            "score": score,
            "score_product": products(score, score),
            "difference": np.where(np.isnan(cross[..., :1]), np.nan, difference)[None],
            "difference_product": products(difference, difference)[None],
            "cross": cross[None],
            **_lengths(mixed - a[:, None]),
        }

    def _morris(self, rows: Sequence[int], values: Array) -> dict[str, Array]:
        points = self.points
        designed = unit_rows("morris", points.sampling, points.seed, rows, self.factors)
        (before, after), step = legs(designed)  # rows, factors
        row = np.arange(len(rows))[:, None]
        effect = (values[row, after] - values[row, before]) / step[..., None]
        score = np.moveaxis(coefficients(values), 1, 0)
        difference = coefficients(effect)
        return {
            "score": score,
            "score_product": products(score, score),
            "difference": difference[None],
            "difference_product": products(difference, difference)[None],
            **_lengths(effect),
        }


def _lengths(curves: Array) -> dict[str, Array]:
    """Return what differences (rows, factors, points) add to the sums of their lengths."""
    size = length(curves)
    size = np.where(size <= LARGEST_FOURTH, size, np.nan)
    square = size * size
    return {"size": size[None], "root": np.sqrt(size)[None], "fourth": (square * square)[None]}
