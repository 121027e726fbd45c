"""Indices of a function from a surrogate and the runs that the surrogate did not see.

The variance of a part of a function f is a square: <f, P f> with an orthogonal projection P. With a
surrogate m and what it misses, r = f - m,

    <f, P f> = <m, P m> + 2 <P m, r> + <r, P r>.

The first term is known of a surrogate, the second is a mean over runs, and the third lies between 0
and <r, r>, which is a mean over runs too (Da Veiga and Gamboa 2013, Efficient estimation of
sensitivity indices, for the expansion). If r is of runs that m was not fitted to, both means are
without bias, whatever m is; so every tenth of the runs is held out in turn (cross-fitting:
Chernozhukov et al. 2018, Double/debiased machine learning). A bad surrogate gives wide intervals,
not wrong ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from analysis.sensitivity.fewer_runs.parts import Surrogate

Array = NDArray[np.float64]

#: Parts that are held out in turn.
FOLDS = 10

#: Degrees of freedom that few large deviations leave of Student's t at least, as
#: `analysis.sensitivity.estimators.intervals` has it.
_LEAST_FREEDOM = 3.0


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Indices of all factors, shape (factors,) each."""

    value: Array
    low: Array
    high: Array


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """What held-out runs made of a surrogate."""

    #: Share of the variance that predictions of held-out runs explain (Q2); 1 is perfect.
    explained: float
    first_order: Interval
    total_order: Interval


@dataclass(frozen=True)
class HeldOut:
    """What surrogates without each fold say of the runs in it."""

    #: Of each run: what was missed (n,); the surrogate's centred value (n,); parts (n, factors).
    missed: Array
    centred: Array
    first: Array
    total: Array
    #: Mean squares over the cube, of the surrogate without the run: (n,), (n, factors).
    variance: Array
    first_squares: Array
    total_squares: Array

    def explained(self, y: Array) -> float:
        """Return the share of the variance of `y` that is explained (Q2; Marrel et al. 2009)."""
        return 1.0 - float((self.missed**2).sum() / ((y - y.mean()) ** 2).sum())

    def beyond(self, x: Array) -> float:
        """Return the share of the variance that may lie beyond the outermost runs `x`.

        A first-order part whose square is bounded has a share of the outermost e of a factor that
        falls with e; that of a heavy tail falls with a smaller power of e. The power between 1/8
        and 1/32 is taken on to 1/n (regular variation, as of Karamata 1930), and the share that the
        outermost run has itself is taken off.
        """
        n, most = len(x), 0.0
        squares = self.first**2 / (n * float(self.variance.mean()))
        for at in (x, 1.0 - x):
            wide = np.where(at < 1.0 / 8.0, squares, 0.0).sum(axis=0)
            narrow = np.where(at < 1.0 / 32.0, squares, 0.0).sum(axis=0)
            falls = np.divide(narrow, wide, out=np.zeros_like(wide), where=wide > 0.0)
            last = squares[np.argmin(at, axis=0), np.arange(x.shape[1])]
            most = max(most, float((narrow * falls ** np.emath.logn(4.0, n / 32.0) - last).max()))
        return most

    def between(self, x: Array) -> float:
        """Return the share of the variance that may lie between the runs `x`, off the ends.

        As `beyond`, about where a first-order part is largest: a narrow peak inside a factor's
        range, to which few runs come close, grows there as a tail does towards an end. Of mean
        squares times widths, since runs lie unevenly (regular variation, Karamata 1930). Of several
        peaks each is looked at by itself.
        """
        n, most = len(x), 0.0
        squares = self.first**2 / float(self.variance.mean())
        for place, of_factor in zip(x.T, squares.T, strict=True):
            highest = place[np.argsort(-of_factor)[: max(n // 64, 1)]]
            near = np.abs(highest - highest[:, None]) < 1.0 / 16.0
            for middle in {float(np.median(highest[one])) for one in near}:
                most = max(most, _near(middle, place, of_factor))
        return most


def _near(middle: float, place: Array, squares: Array) -> float:
    """Return the share of the variance that may lie between runs about a place of a factor.

    Args:
        place: of the runs in the factor, shape (n,).
        squares: of its part there, as shares of the variance.
    """
    if abs(middle - 0.5) > 0.5 - 1.0 / 16.0:
        return 0.0
    off = np.abs(place - middle)
    wide, narrow = (
        width * float(squares[off < 0.5 * width].mean()) if (off < 0.5 * width).any() else 0.0
        for width in (1.0 / 8.0, 1.0 / 32.0)
    )
    if not wide > 0.0:
        return 0.0
    falls = min(narrow / wide, 1.0)
    last = float(squares.max()) / len(place)
    return float(narrow * falls ** float(np.emath.logn(4.0, len(place) / 32.0)) - last)


def folds(seed: int, n: int) -> Sequence[NDArray[np.bool_]]:
    """Return which of `n` runs are held out in turn (Chernozhukov et al. 2018)."""
    fold = np.random.default_rng([seed, n]).permutation(n) % FOLDS
    return [fold == part for part in range(min(FOLDS, n))]


def held_out(surrogate: Surrogate, y: Array, seed: int) -> HeldOut:
    """Fit without each fold and look at it (cross-fitting, Chernozhukov et al. 2018)."""
    n, found = len(y), []
    every = folds(seed, n)
    for away in every:
        parts = surrogate.without(y, away)
        shape = (int(away.sum()), 1)
        found.append(
            (
                y[away] - parts.value,
                parts.centred,
                parts.first,
                parts.total,
                np.full(shape[0], parts.variance),
                np.tile(parts.first_squares, shape),
                np.tile(parts.total_squares, shape),
            )
        )
    back = np.argsort(np.concatenate([np.flatnonzero(away) for away in every]))
    joined = (np.concatenate(one)[back] for one in zip(*found, strict=True))
    return HeldOut(*joined)


def corrected(y: Array, held: HeldOut, level: float) -> Corrected:
    """Return indices with intervals at `level` (Da Veiga and Gamboa 2013, section 2).

    Each interval reaches from where nothing of what the surrogate missed belongs to the factor to
    where all of it does, and at both ends by Student's quantile of standard errors further.
    """
    r = held.missed
    of_variance = held.variance + 2.0 * held.centred * r + r**2 - r.mean() ** 2
    variance = float(of_variance.mean())
    found = {}
    for name, parts, squares in (
        ("first_order", held.first, held.first_squares),
        ("total_order", held.total, held.total_squares),
    ):
        ends = []
        for share in (0.0, 1.0):
            noisy = 2.0 * parts * r[:, None] + share * (r**2)[:, None]
            index = (squares + noisy).mean(axis=0) / variance
            moved = noisy - index * (of_variance - held.variance)[:, None]
            ends.append((index, _error(moved, level) / variance))
        (lower, below), (upper, above) = ends
        found[name] = Interval(
            value=np.clip(0.5 * (lower + upper), 0.0, 1.0),
            low=np.clip(lower - below, 0.0, 1.0),
            high=np.clip(upper + above, 0.0, 1.0),
        )
    return Corrected(explained=held.explained(y), **found)


def _error(moved: Array, level: float) -> Array:
    """Return half the width of the interval of the mean over runs, shape (factors,)."""
    n = len(moved)
    squares = (moved - moved.mean(axis=0)) ** 2
    whole, fourth = squares.sum(axis=0), (squares**2).sum(axis=0)
    # How many of equal size would make up the variance (Kish 1965, section 11.7).
    rests = np.divide(whole**2, fourth, out=np.full_like(whole, n), where=fourth > 0.0)
    freedom = np.clip(rests, _LEAST_FREEDOM, n - 1)
    error = np.sqrt(whole / (n * (n - 1)))
    return np.asarray(stdtrit(freedom, 0.5 + 0.5 * level) * error)
