"""Rows of a bank as what is learnt from: recordings, targets and factors in their deviations.

What a measurement leaves of the variance does not depend on its value if errors of targets and of
factors are jointly normal (Rasmussen and Williams 2006, Gaussian processes for machine learning,
equation A.6). So it is with deviations from a mean, and not with normal scores.
"""

import numpy as np

from analysis.interpretation.bank.bank import LOCAL, Bank, Samples

JOINTS = 4


def noisy(bank: Bank, samples: Samples) -> np.ndarray:
    """Return the recordings of a bank with the zero errors that sensors have, shape (n, both)."""
    return samples.curves(bank.population.zero_errors(bank.seed, samples.rows, JOINTS))


def targets_of(samples: Samples) -> np.ndarray:
    """Return the truth of TARGETS, shape (n, TARGETS): restoring sense, Nm/rad and Nm s/rad."""
    return np.hstack([samples.of("true_stiffness", "true_damping"), -samples.of(*LOCAL)])


def in_deviations(factors: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return how far factors (..., f) are from their means, over their standard deviations.

    Args:
        factors: in their units.
        scale: means and standard deviations, shape (2, f).
    """
    return np.asarray((factors - scale[0]) / scale[1])
