"""Rows of a bank as what is learnt from: recordings, targets and factors as normal scores.

A normal score is the standard normal quantile of a value's place among the others (Conover 1999,
Practical nonparametric statistics, section 5.10).
"""

import numpy as np
from scipy.special import ndtri

from analysis.interpretation.bank.bank import LOCAL, Bank, Samples

JOINTS = 4


def noisy(bank: Bank, samples: Samples) -> np.ndarray:
    """Return the recordings of a bank with the zero errors that sensors have, shape (n, both)."""
    return samples.curves(bank.population.zero_errors(bank.seed, samples.rows, JOINTS))


def targets_of(samples: Samples) -> np.ndarray:
    """Return the truth of TARGETS, shape (n, TARGETS): restoring sense, Nm/rad and Nm s/rad."""
    return np.hstack([samples.of("true_stiffness", "true_damping"), -samples.of(*LOCAL)])


def normal_scores(ordered: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the normal scores of values (n, f) among sorted ones (rows, f), shape (n, f)."""
    places = positions(len(ordered))
    columns = []
    for i in range(ordered.shape[1]):
        own, where = np.unique(ordered[:, i], return_inverse=True)
        level = np.bincount(where, places) / np.bincount(where)
        columns.append(np.interp(values[:, i], own, level))
    return np.column_stack(columns)


def positions(count: int) -> np.ndarray:
    """Return the normal scores of so many sorted values, shape (count,)."""
    return np.asarray(ndtri((np.arange(count) + 0.5) / count))
