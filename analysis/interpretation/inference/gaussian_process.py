"""Gaussian process regression of several outputs with one kernel (Rasmussen and Williams 2006).

The kernel's parameters are found on some of the rows; all rows then share it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dtrtri

from analysis.interpretation.inference.marginal_likelihood import tuned as tuned_on

#: Rows on which the kernel's parameters are found: the time grows with their cube.
TUNING_ROWS = 400
#: Each output takes the noise, in units of the kernel's own, with which others predict it best.
NOISES = (1.0, 10.0, 100.0, 1000.0)


@dataclass(frozen=True, kw_only=True)
class GaussianProcess:
    """A smooth and a linear part over d inputs, for m outputs."""

    #: Inputs of the rows, shape (n, d).
    inputs: np.ndarray
    #: Their outputs' weights, shape (n, m): the covariance's inverse times the outputs.
    weights: np.ndarray
    #: Length over which the smooth part varies, in units of each input, shape (d,).
    lengths: np.ndarray
    #: Variances of the smooth and the linear part and of noise, as shares of an output's, (3,).
    variances: np.ndarray
    #: Mean and standard deviation of each output, shape (2, m).
    scale: np.ndarray
    #: Prediction errors of each row from all others (equation 5.12), shape (n, m).
    residuals: np.ndarray

    @classmethod
    def fit(
        cls, inputs: np.ndarray, outputs: np.ndarray, *, tuned: int, seed: int
    ) -> "GaussianProcess":
        """Learn from rows.

        Args:
            inputs: shape (n, d), standardised.
            outputs: shape (n, m).
            tuned: how many of the outputs, from the first, the kernel is made for.
            seed: chooses the rows on which it is.
        """
        scale = np.array([outputs.mean(axis=0), np.maximum(outputs.std(axis=0), 1e-12)])
        y = (outputs - scale[0]) / scale[1]
        rng = np.random.default_rng(seed)
        some = rng.permutation(len(inputs))[:TUNING_ROWS]
        lengths, variances = tuned_on(inputs[some], y[some, :tuned])
        covariance = _covariance(inputs, inputs, lengths, variances)
        weights, residuals = np.zeros_like(y), np.full_like(y, np.inf)
        for times in NOISES:
            # In LAPACK's own order, so that it need not be copied once more.
            own = covariance.copy(order="F")
            own[np.diag_indices_from(own)] += times * variances[2]
            factor = cho_factor(own, lower=True, overwrite_a=True, check_finite=False)
            tried = cho_solve(factor, y, check_finite=False)
            errors = tried / _diagonal_of_inverse(factor[0])[:, None]
            better = (errors**2).sum(axis=0) < (residuals**2).sum(axis=0)
            weights[:, better], residuals[:, better] = tried[:, better], errors[:, better]
        return cls(
            inputs=inputs,
            weights=weights,
            lengths=lengths,
            variances=variances,
            scale=scale,
            residuals=residuals * scale[1],
        )

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Return the outputs' means at `inputs` (k, d), shape (k, m)."""
        covariance = _covariance(inputs, self.inputs, self.lengths, self.variances)
        return np.asarray(covariance @ self.weights * self.scale[1] + self.scale[0])


def _diagonal_of_inverse(factor: np.ndarray) -> np.ndarray:
    """Return the diagonal of the inverse of a matrix from its lower Cholesky factor, (n,).

    The factor is overwritten. Its own inverse takes half of the time that the whole matrix's does.
    """
    root, _ = dtrtri(factor, lower=1, overwrite_c=1)
    return np.array([column[i:] @ column[i:] for i, column in enumerate(root.T)])


def _covariance(
    one: np.ndarray, other: np.ndarray, lengths: np.ndarray, variances: np.ndarray
) -> np.ndarray:
    a, b = one / lengths, other / lengths
    # In place: with thousands of rows to make another array takes as long as to fill it.
    smooth = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)
    smooth -= 2.0 * a @ b.T
    np.maximum(smooth, 0.0, out=smooth)
    smooth *= -0.5
    np.exp(smooth, out=smooth)
    smooth *= variances[0]
    linear = one @ other.T
    linear += 1.0
    linear *= variances[1]
    smooth += linear
    return np.asarray(smooth)
