"""How large errors of prediction are by what is predicted: a stiff limb is told less exactly.

A factor that nobody knows, such as a torque's scale, is off by a share of K, so errors grow with
it. A variance function (Davidian and Carroll 1987, Variance function estimation): the logarithm of
the expected square is linear in what is predicted of the targets and in the logarithm of its
magnitude (a gamma regression, McCullagh and Nelder 1989, Generalized linear models, section 8).
"""

from dataclasses import dataclass

import numpy as np

#: Penalty on the slopes, over standardised inputs; chosen with the inputs on a bank's own rows.
PENALTY = 0.1
#: Parts into which rows are divided to size each row's errors from the others.
FOLDS = 10
#: Most steps of the regression.
STEPS = 200
#: Of how many times a size an error can be in a step that goes too far.
LARGEST_LOGARITHM = 500.0
#: Least square of an error, as a share of the mean: an error of none has no logarithm.
LEAST = 1e-4


@dataclass(frozen=True, kw_only=True)
class ErrorSizes:
    """Sizes of errors of m quantities by what is predicted of k targets."""

    #: Least and largest predictions of the rows, shape (2, k): beyond them errors are as there.
    ends: np.ndarray
    #: Root mean square of each target's predictions, shape (k,).
    unit: np.ndarray
    #: Mean and standard deviation of what is regressed on, shape (2, 2 k).
    scale: np.ndarray
    #: Of a constant and of these, shape (1 + 2 k, m).
    weights: np.ndarray

    @classmethod
    def fit(cls, predicted: np.ndarray, errors: np.ndarray) -> "ErrorSizes":
        """Learn from rows.

        Args:
            predicted: of the targets, shape (n, k).
            errors: of whatever is predicted of the same rows, shape (n, m).
        """
        ends = np.array([predicted.min(axis=0), predicted.max(axis=0)])
        unit = np.maximum(np.sqrt((predicted**2).mean(axis=0)), 1e-12)
        both = _inputs(predicted, unit)
        scale = np.array([both.mean(axis=0), np.maximum(both.std(axis=0), 1e-12)])
        squared = errors**2
        squared = np.maximum(squared, np.maximum(LEAST * squared.mean(axis=0), 1e-24))
        weights = _regressed((both - scale[0]) / scale[1], squared)
        return cls(ends=ends, unit=unit, scale=scale, weights=weights)

    def at(self, predicted: np.ndarray) -> np.ndarray:
        """Return the root mean square of errors to expect at predictions (n, k), shape (n, m)."""
        both = _inputs(np.clip(predicted, *self.ends), self.unit)
        inputs = (both - self.scale[0]) / self.scale[1]
        return np.asarray(np.exp(0.5 * (self.weights[0] + inputs @ self.weights[1:])))


def sizes_of_rows(predicted: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return how large the errors of each row are as the other rows tell it, shape (n, m)."""
    fold = np.arange(len(predicted)) % FOLDS
    found = np.empty_like(errors)
    for number in range(FOLDS):
        others = ErrorSizes.fit(predicted[fold != number], errors[fold != number])
        found[fold == number] = others.at(predicted[fold == number])
    return found


def _inputs(predicted: np.ndarray, unit: np.ndarray) -> np.ndarray:
    return np.hstack([predicted / unit, np.log1p(np.abs(predicted) / unit)])


def _regressed(inputs: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return weights of gamma regressions of values (n, m) on inputs (n, k), shape (1 + k, m).

    Fisher scoring: under a logarithmic link the information does not depend on the weights, so all
    columns share one matrix. A column whose deviance a step would raise, as a few large values do
    that lie far out, takes half of it next time; the deviance is convex, so this ends at its least.
    """
    size = values.mean(axis=0)
    design = np.column_stack([np.ones(len(inputs)), inputs])
    penalty = PENALTY * np.diag([0.0, *np.ones(inputs.shape[1])])
    information = np.linalg.inv(design.T @ design / len(design) + penalty)

    def looked_at(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the deviance of each column, and what each row is over what is expected."""
        logarithm = design @ weights
        # What a step too far would have underflow is as bad as what it would have overflow.
        over = values / size * np.exp(np.minimum(-logarithm, LARGEST_LOGARITHM))
        return (logarithm + over).mean(axis=0) + 0.5 * (weights * (penalty @ weights)).sum(
            axis=0
        ), over

    weights = np.zeros((design.shape[1], values.shape[1]))
    deviance, over = looked_at(weights)
    rate = np.full(values.shape[1], 0.5)
    for _ in range(STEPS):
        step = information @ (design.T @ (over - 1.0) / len(design) - penalty @ weights)
        tried = weights + rate * step
        then, over_then = looked_at(tried)
        better = then <= deviance
        weights[:, better], over[:, better] = tried[:, better], over_then[:, better]
        deviance[better] = then[better]
        rate = np.where(better, np.minimum(1.5 * rate, 0.5), 0.5 * rate)
        if np.abs(step).max() < 1e-6:
            break
    weights[0] += np.log(size)
    return weights
