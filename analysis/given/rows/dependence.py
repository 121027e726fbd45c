"""Which factors of a sample depend on each other, in whatever form."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isqrt

import numpy as np
from numpy.typing import NDArray
from scipy.stats import hypergeom, norm, rankdata

from analysis.given.measures.hdmr import INDISTINCT
from analysis.given.measures.hsic import hsic_of_pairs
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE

Array = NDArray[np.float64]

#: Rank correlation from which the answer mentions it, beyond chance: of two factors of equal weight
#: each tells half of it too much. Rows that are not independent correlate by chance, so twice.
_CORRELATED = 2.0 * SHARE_OF_VARIANCE
#: How likely one pair or more of a table is named if all its factors are independent: by ranks, and
#: by HSIC as the gamma distribution has it. Its tail is too light; with this, set while looking at
#: independent tables, it is rarer than 1 %.
_BY_RANKS, _BY_HSIC = 5e-3, 3e-4
#: R2-HSIC from which the answer mentions it.
_LEAST_SHARE = 0.03
#: Times that rare values of two factors coincide by chance, from which ranks tell of them.
_EXPECTED = 5
#: Rows and factors that HSIC looks at, at most, numbers it holds, and steps it takes.
_MOST_ROWS, _MOST_FACTORS, _MOST_HELD, _MOST_STEPS = 500, 500, 2e7, 4e9
#: HSIC's distribution by chance is known of so many rows and more (Gretton et al. 2007).
_FEWEST_ROWS = 6
#: Pairs that are shown.
_SHOWN = 5


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Factors that are not independent of each other (Spearman 1904; Gretton et al. 2007)."""

    #: What to say of it; empty if all are independent.
    remarks: list[str]
    #: Every two of them, by their places.
    pairs: list[tuple[int, int]]


def dependence(factors: Sequence[str], x: Array, *, drawn: bool = True) -> Dependence:
    """Say which factors are not independent of each other.

    By their ranks (Spearman 1904); of a dependence that neither rises nor falls by R2-HSIC of
    their ranks (Gretton et al. 2007), each of all pairs at its part of the level (Bonferroni).

    Args:
        x: shape (rows, factors), in an order that has nothing to do with them.
        drawn: rows are independent of each other. Of others HSIC takes chance for dependence.
    """
    # Of a design's rows only those may be left in which a factor is the same.
    varies = np.ptp(x, axis=0) > 0.0
    factors, x = [name for name, one in zip(factors, varies, strict=True) if one], x[:, varies]
    place = np.flatnonzero(varies).tolist()
    if len(factors) < 2:
        return Dependence(remarks=[], pairs=[])
    # Equal values share a rank: by the order of rows, a grid's factors would seem to be related.
    ranks = rankdata(x, axis=0)
    correlation: Array = np.asarray(np.corrcoef(ranks, rowvar=False))
    said = []
    bent: list[tuple[int, int]] = []
    pairs = list(combinations(range(len(factors)), 2))
    small = _CORRELATED if drawn else 2.0 * _CORRELATED
    least = max(small, float(norm.isf(_BY_RANKS / 2.0 / len(pairs))) / np.sqrt(len(x)))
    rising = [p for p in pairs if abs(correlation[p]) >= least]
    if rising:
        rare = _rare(x)
        rising = [p for p in rising if _together(rare[:, p]) <= _BY_RANKS / len(pairs)]
    if rising:
        rising.sort(key=lambda p: -abs(correlation[p]))
        said.append(f"rank correlation: {_shown(factors, rising, correlation, '+.2f')}")
    if drawn and len(x) >= _FEWEST_ROWS:
        looked = ranks[:, :_MOST_FACTORS]
        share, p_value = hsic_of_pairs(looked[: _most_rows(looked.shape[1])])
        named = np.argwhere(np.triu(p_value < _BY_HSIC / len(pairs), k=1)).tolist()
        known = set(rising)
        bent = [(i, j) for i, j in named if (i, j) not in known and share[i, j] >= _LEAST_SHARE]
        if bent:
            bent.sort(key=lambda p: -share[p])
            said.append(
                f"neither rising nor falling, by R²-HSIC: {_shown(factors, bent, share, '.2f')}"
            )
    if not said:
        return Dependence(remarks=[], pairs=[])
    remarks = [
        f"Factors depend on each other ({'; '.join(said)}). What one of them explains, the other "
        "does too: indices of factors say what a factor tells of the output, not what it causes.",
        *_one_quantity(factors, [p for p in rising if abs(correlation[p]) > 1.0 - INDISTINCT]),
    ]
    return Dependence(remarks=remarks, pairs=[(place[i], place[j]) for i, j in (*rising, *bent)])


def _one_quantity(factors: Sequence[str], pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Say which factors are copies of each other to so many digits that `hdmr` takes them for one.

    (Belsley et al. 1980; `analysis.given.measures.hdmr.INDISTINCT`.)
    """
    if not pairs:
        return []
    shown = ", ".join(f"{factors[i]} and {factors[j]}" for i, j in pairs[:_SHOWN])
    more = f" and {len(pairs) - _SHOWN} pairs more" if len(pairs) > _SHOWN else ""
    return [
        f"As good as one quantity: {shown}{more}. hdmr deals what it explains to both in equal "
        "parts, and what their small difference does it does not see: leave one of them out, and "
        "if the difference matters, give it as a factor."
    ]


def _rare(x: Array) -> NDArray[np.bool_]:
    """Return where factors have another value than their commonest."""
    commonest = []
    for column in x.T:
        values, often = np.unique(column, return_counts=True)
        commonest.append(values[often.argmax()])
    return np.asarray(x != np.array(commonest), dtype=np.bool_)


def _together(rare: NDArray[np.bool_]) -> float:
    """Return how likely rare values of two factors coincide so often by chance (Fisher 1922).

    0 where they are expected to five times (Cochran 1954): ranks are normal enough then.
    """
    one, other = rare.sum(axis=0).tolist()
    if one * other >= _EXPECTED * len(rare):
        return 0.0
    return float(hypergeom.sf(rare.all(axis=1).sum() - 1, len(rare), one, other))


def _most_rows(factors: int) -> int:
    """Return how many rows the cost allows, which grows with the square of rows and of factors."""
    held, steps = isqrt(int(_MOST_HELD) // factors), isqrt(int(_MOST_STEPS)) // factors
    return max(64, min(_MOST_ROWS, held, steps))


def _shown(
    factors: Sequence[str], pairs: Sequence[tuple[int, int]], found: Array, form: str
) -> str:
    shown = ", ".join(
        f"{factors[i]} and {factors[j]} ({found[i, j]:{form}})" for i, j in pairs[:_SHOWN]
    )
    return shown + (f" and {len(pairs) - _SHOWN} pairs more" if len(pairs) > _SHOWN else "")
