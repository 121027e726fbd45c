"""Whether a number stands for none, such as -999, or 0 of runs that failed.

Of values that hardly repeat one that is there again and again is no draw: another row has one that
no row has yet (Good 1953, The population frequencies of species and the estimation of population
parameters).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE

Array = NDArray[np.float64]

#: A number that no other comes near is no chance if it is there so often.
_AGAIN = 3
#: Share of the rows that have one value of an output from which that jump matters.
_OFTEN = 0.05
#: How likely a value of one that rounding repeats is taken for such a number, and how many values
#: next to it say how often rounding does.
_BY_CHANCE, _NEXT = 1e-3, 10


def no_value(name: str, numbers: Array) -> str:
    """Return the remark on a number that may stand for none, such as -999, or nothing.

    It is there again and again, and as far from all others, which hardly repeat, as they go
    (Good 1953).
    """
    values, often = np.unique(numbers[~np.isnan(numbers)], return_counts=True)
    for at, rest in ((0, slice(1, None)), (-1, slice(-1))):
        others = values[rest]
        if len(others) < 2 or often[at] < _AGAIN or not _hardly_repeat(often[rest]):
            continue
        if np.abs(others - values[at]).min() > np.ptp(others):
            return (
                f"{name} is {values[at]:g} in {often[at]} rows, and from {others[0]:g} to "
                f"{others[-1]:g} in the others: if that stands for no value, leave it empty."
            )
    return ""


def atom(name: str, numbers: Array) -> str:
    """Return the remark on a value that many rows share of an output that else hardly repeats.

    So many, or fewer that are so far from the others that they make what matters of its variance,
    as 0 in a fiftieth of rows that go from 2 to 10 else. (Good 1953.)
    """
    there = numbers[~np.isnan(numbers)]
    # Rounding leaves -0, which reads as another number.
    values, often = np.unique(there + 0.0, return_counts=True)
    if no_value(name, numbers):
        return ""
    for at in dict.fromkeys((int(np.argmax(often)), 0, len(values) - 1)):
        if not _hardly_repeat(np.delete(often, at)):
            continue
        if often[at] >= max(_AGAIN, _OFTEN * len(there)) or (
            _beyond_rounding(values, often, at) and _share(there, values[at]) >= SHARE_OF_VARIANCE
        ):
            return (
                f"{name} is {values[at]:g} in {often[at]:,} of {len(there):,} rows, and hardly "
                "repeats in the others. If that stands for runs that failed, leave them empty: the "
                "jump counts as what factors do. If it is a limit, or truly so often, it is well."
            )
    return ""


def _hardly_repeat(often: NDArray[np.intp]) -> bool:
    return bool((often == 1).sum() > len(often) / 2)


def _share(numbers: Array, value: float) -> float:
    """Return the share of the variance that lies between the rows of one value and the others."""
    is_value = numbers == value
    between = is_value.mean() * (1.0 - is_value.mean())
    apart = numbers[~is_value].mean() - value
    return float(between * apart**2 / numbers.var())


def _beyond_rounding(values: Array, often: NDArray[np.intp], at: int) -> bool:
    """Say whether a value repeats more than rounding makes the others do, or those next to it.

    Rows that share a rounded value beside one of them are Poisson's, as many as all have on
    average; two more pairs than are seen are taken to be there.
    """
    others = np.delete(often, at)
    near = others[np.argsort(np.abs(np.delete(values, at) - values[at]))[:_NEXT]]
    beside = [
        (float((one * (one - 1.0)).sum()) + more) / float(one.sum())
        for one, more in ((others, 2.0), (near, 0.0))
    ]
    return often[at] >= _AGAIN and bool(pdtrc(often[at] - 2.0, max(beside)) < _BY_CHANCE)
