"""A kernel's parameters by the greatest marginal likelihood (Rasmussen and Williams 2006, 5.4.1).

The kernel is a smooth part with a length for each input, a linear part, and noise. scikit-learn
finds the same, which a test holds, but makes a matrix for each length's slope: twenty times as long
with 24 inputs. A length's slope is two sums over one matrix.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

#: Where the search begins, and between what it is held: the smooth part's variance, its lengths,
#: the linear part's variance and the noise's.
START = (1.0, 6.0, 0.1, 0.05)
BOUNDS = ((1e-3, 1e3), (0.3, 1e3), (1e-5, 1e2), (1e-5, 2.0))
#: Added to the noise, so that rows that are alike have an inverse.
JITTER = 1e-8


def tuned(inputs: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths, shape (d,), and the variances of smooth part, linear part and noise, (3,).

    Args:
        inputs: shape (n, d).
        outputs: shape (n, m), each of mean 0 and variance 1.
    """
    shape = (1, inputs.shape[1], 1, 1)
    start = np.log(np.repeat(START, shape))
    bounds = np.log(np.repeat(BOUNDS, shape, axis=0))
    found = minimize(
        lambda at: tuple(-one for one in likelihood(at, inputs, outputs)),
        start,
        jac=True,
        bounds=bounds,
        method="L-BFGS-B",
    )
    values = np.exp(found.x)
    return values[1:-2], np.array([values[0], values[-2], values[-1] + JITTER])


def likelihood(at: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the logarithm of the marginal likelihood (equation 5.8) and its slope (5.9).

    Args:
        at: logarithms of the smooth part's variance, its lengths, the linear part's variance and
            the noise's, shape (1 + d + 2,).
        inputs: shape (n, d).
        outputs: shape (n, m).
    """
    values = np.exp(at)
    scaled = inputs / values[1:-2]
    squares = (scaled**2).sum(axis=1)
    squared = squares[:, None] + squares - 2.0 * scaled @ scaled.T
    smooth = values[0] * np.exp(-0.5 * np.maximum(squared, 0.0))
    linear = values[-2] * (1.0 + inputs @ inputs.T)
    covariance = smooth + linear
    covariance[np.diag_indices_from(covariance)] += values[-1] + JITTER
    try:
        factor = cho_factor(covariance, lower=True, check_finite=False)
    except LinAlgError:
        return -np.inf, np.zeros_like(at)
    weights = cho_solve(factor, outputs, check_finite=False)
    count, width = outputs.shape
    value = (
        -0.5 * np.sum(outputs * weights)
        - width * np.log(np.diag(factor[0])).sum()
        - 0.5 * count * width * np.log(2.0 * np.pi)
    )
    lower = np.tril(dpotri(factor[0], lower=True)[0])
    inverse = lower + np.tril(lower, -1).T
    pull = 0.5 * (weights @ weights.T - width * inverse)
    of_smooth = pull * smooth
    along = 2.0 * (
        of_smooth.sum(axis=1) @ scaled**2 - np.einsum("nd,nd->d", scaled, of_smooth @ scaled)
    )
    slope = (of_smooth.sum(), *along, np.sum(pull * linear), values[-1] * np.trace(pull))
    return float(value), np.array(slope)
