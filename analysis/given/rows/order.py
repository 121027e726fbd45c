"""Whether each row goes on from the one before, as steps of a chain or of a time series do.

Such rows tell less than as many independent ones, and a factor that drifts as the output does looks
influential (Yule 1926, Why do we sometimes get nonsense-correlations between time-series?).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, f_oneway, norm, rankdata

from analysis.given.doubts.left_over import alike, by_themselves
from analysis.given.measures.measure import standard

Array = NDArray[np.float64]

#: How likely one column or more of a table drawn independently is said to follow, and how likely
#: steps upwards and downwards of a column that was not sorted are as unlike in number.
_BY_CHANCE = 1e-3
#: Correlation with the row before from which intervals are a fifth too narrow or more: 0.22 is its
#: square where (1 + r^2) / (1 - r^2) is 1.25 squared. (Looked at on Sobol's sequence of which every
#: seventh point was kept, where it is 0.43 at most.)
_LEAST = 0.47
#: Rank correlation with the row's number from which a column is in order, but for what is less than
#: its steps: of m levels in loops, each jittered, it is 1 - 1 / m^2, 0.89 of three.
_IN_ORDER = 0.85
#: How likely one factor or more of a table drawn independently seems to follow a little, so that
#: what is left of the output may follow for that.
_A_LITTLE = 0.01
#: After how many rows something may come back, and how many times over it has to be seen.
_TURNS, _ROWS_A_TURN = range(2, 13), 8
#: Rows of which what is left is looked at, the first of a table.
_MOST_ROWS = 2000
#: Factors that are shown.
_SHOWN = 5


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Factors that go on from row to row."""

    #: Which, the strongest first, and how their ranks correlate with those of the row before.
    factors: Sequence[int]
    correlation: Sequence[float]
    #: How many independent rows determine a variance as well.
    rows: float

    def sentence(self, names: Sequence[str], rows: int) -> str:
        """Return what to say of it, with the names of all factors and the number of rows."""
        shown = ", ".join(
            f"{names[f]} ({r:+.2f})"
            for f, r in zip(self.factors[:_SHOWN], self.correlation, strict=False)
        )
        more = len(self.factors) - _SHOWN
        return (
            "Rows go on from the row before, as those of a Markov chain or of a time series do "
            f"(rank correlation with it: {shown}{f' and {more} more' if more > 0 else ''}). "
            f"They are not drawn independently, and tell as much as about {self.rows:.0f} rows of "
            f"{rows:,} would: intervals are too narrow, and p-values too small. Give every so many "
            "rows only. If the table was sorted so, it does not matter."
        )


def chain(x: Array, y: Array) -> Chain | None:
    """Return which factors go on from row to row; None if none does, or rows were sorted.

    By von Neumann's ratio of ranks (Bartels 1982, The rank version of von Neumann's ratio test for
    randomness), each factor at its part of the level (Bonferroni). A variance of such rows is
    told as well as by (1 - r^2) / (1 + r^2) times as many (Bayley and Hammersley 1946, The
    effective number of independent observations in an autocorrelated time series).

    Args:
        x, y: factors and outputs, shape (rows, factors) and (rows, outputs), in the file's order.
    """
    rows = len(x)
    if any(_sorted(column) for column in (*x.T, *y.T)):
        return None
    least = max(_LEAST, float(norm.isf(_BY_CHANCE / x.shape[1])) / np.sqrt(rows))
    found = []
    for f, column in enumerate(x.T):
        # Of a factor of few values, as of a grid, loops make blocks.
        if len(np.unique(column)) <= rows / 2:
            continue
        correlation = _with_the_row_before(column)
        if correlation >= least and not _sawtooth(column):
            found.append((correlation, f))
    if not found:
        return None
    found.sort(reverse=True)
    strongest = found[0][0] ** 2
    return Chain(
        factors=[f for _, f in found],
        correlation=[r for r, _ in found],
        rows=max(rows * (1.0 - strongest) / (1.0 + strongest), 1.0),
    )


def rest_in_order(output: str, y: Array, factors: Sequence[str], x: Array) -> list[str]:
    """Say so if what factors leave of an output goes on from row to row, as of batches or drift.

    By von Neumann's ratio (1941) of what is left when each factor's own function is taken off. Of
    rows that are in the order of a factor or output nothing can be told, nor where factors go on.

    Args:
        output, factors: names.
        y: shape (rows,), in the file's order.
        x: shape (rows, factors).
    """
    x, y = x[:_MOST_ROWS], y[:_MOST_ROWS]
    steps = np.diff(y)
    if (steps >= 0.0).all() or (steps <= 0.0).all():
        return []
    if any(_sorted(column) for column in x.T if np.ptp(column) > 0.0):
        return []
    little = float(norm.isf(_A_LITTLE / 2.0 / len(factors))) / np.sqrt(len(y))
    if any(abs(_with_the_row_before(column)) > little for column in x.T if np.ptp(column) > 0.0):
        return []
    y = standard(y)
    left = y - by_themselves(x, y).sum(axis=1)
    row = np.arange(len(left))
    if alike(left, row[1:], row[:-1]).errors < norm.isf(_BY_CHANCE):
        return _by_turns(output, left, x)
    correlation = float(left[1:] @ left[:-1]) / float(left @ left)
    return [
        f"What the factors leave of {output} goes on from row to row (correlation with the row "
        f"before: {correlation:+.2f}), as where batches share an offset or something drifts: rows "
        "are not independent, and intervals may be too narrow. If the table tells what changed, "
        "such as a batch or the time, give it as a factor."
    ]


def _by_turns(output: str, left: Array, x: Array) -> list[str]:
    """Say so if what factors leave of an output comes back every so many rows (Fisher's F).

    As where machines take turns. Nothing where a factor does, as loops make it: what it does beside
    others comes back, too.

    Args:
        output: its name.
        left: what the factors leave of it, shape (rows,), in the file's order.
        x: shape (rows, factors).
    """
    periods = [every for every in _TURNS if len(left) >= _ROWS_A_TURN * every]
    chances = [_chance_by_turns(left, every) for every in periods]
    if not periods or min(chances) * len(periods) > _BY_CHANCE:
        return []
    every = periods[int(np.argmin(chances))]
    ranks = [rankdata(column) for column in x.T if np.ptp(column) > 0.0]
    if any(_chance_by_turns(rank, every) * len(ranks) < _A_LITTLE for rank in ranks):
        return []
    means = np.array([left[turn::every].mean() for turn in range(every)])
    share = float(np.mean(means**2) / np.mean(left**2))
    return [
        f"What the factors leave of {output} comes back every {every} rows ({share:.0%} of it), as "
        "where as many machines or settings take turns. If the table tells which is a row's, give "
        "it as a factor."
    ]


def _chance_by_turns(signal: Array, every: int) -> float:
    """Return how likely the means of rows that are so far apart differ as much by chance."""
    return float(f_oneway(*(signal[turn::every] for turn in range(every))).pvalue)


def _with_the_row_before(column: Array) -> float:
    rank = rankdata(column)
    return float(1.0 - np.sum(np.diff(rank) ** 2) / (2.0 * np.sum((rank - rank.mean()) ** 2)))


def _sorted(column: Array) -> bool:
    """Say whether rows are in the order of a column, or nearly, as of a grid that is jittered."""
    rank = rankdata(column)
    return bool(abs(np.corrcoef(rank, np.arange(len(rank)))[0, 1]) > _IN_ORDER)


def _sawtooth(column: Array) -> bool:
    """Say whether a column rises or falls again and again, as where it is sorted beside another.

    Or as points of a lattice or of Halton's sequence do. A chain rises as often as it falls.
    """
    steps = np.diff(column)
    up, down = int((steps > 0.0).sum()), int((steps < 0.0).sum())
    return bool(up + down > 0 and binomtest(up, up + down).pvalue < _BY_CHANCE)
