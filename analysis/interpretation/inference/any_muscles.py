"""K_h whatever the limb's muscles are: an interval that holds for a set which the bank lacks.

A Gaussian process learns how the bank's muscles shape the torque, and a limb with others misleads
it. Here K is linear in what regressions say and in the movement, and how far it is off is looked at
with each set of muscles left out in turn: cross-validation by groups (Roberts et al. 2017,
Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic
structure), whose errors, over how large they are by the K that is predicted and the arm's length,
make the interval (CV+: Barber et al. 2021, Predictive inference with the jackknife+). What is
measured on the patient corrects it as in `analysis.interpretation.posterior`.
"""

from dataclasses import dataclass

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.inference.error_sizes import ErrorSizes, sizes_of_rows
from analysis.interpretation.inference.features import Features
from analysis.interpretation.inference.posterior import Posterior, corrected
from analysis.interpretation.inference.rows import noisy, normal_scores, targets_of
from sim.models import CURVES, ESTIMATES, WINDOWS

#: Principal components of the elbow's angle over time that are looked at.
COMPONENTS = 6
#: The factor whose values are left out in turn.
MUSCLES = "muscles"


@dataclass(frozen=True, kw_only=True)
class AnyMuscles:
    """A linear model of K and of every factor, and its errors."""

    #: Of the scaled angle, shape (COMPONENTS, WINDOWS).
    shapes: np.ndarray
    #: Of a constant, ESTIMATES and the shapes, shape (1 + ESTIMATES + COMPONENTS, 1 + factors).
    weights: np.ndarray
    #: Of rows whose muscles it was not told of, shape (rows, 1 + factors), and how large these are
    #: to expect, as the other rows tell it.
    errors: np.ndarray
    sizes: np.ndarray
    #: How large they are by the K that is predicted and by what stands beside it.
    expected: ErrorSizes

    @classmethod
    def fit(
        cls,
        scaled: np.ndarray,
        outputs: np.ndarray,
        muscles: np.ndarray,
        judged: np.ndarray,
        beside: np.ndarray,
    ) -> "AnyMuscles":
        """Learn from rows.

        Args:
            scaled: CURVES and ESTIMATES in units of the bank's, shape (n, both).
            outputs: K and the factors' normal scores, shape (n, 1 + factors).
            muscles: the number of each row's set, shape (n,).
            judged: rows whose errors make the interval, a mask; those without contact are told
                from those with it by a constant.
            beside: what else the sizes of their errors go by, shape (judged rows, k).
        """
        angle = scaled[:, :WINDOWS]
        shapes = np.linalg.svd(angle - angle.mean(axis=0), full_matrices=False)[2][:COMPONENTS]
        inputs = np.column_stack([_inputs(scaled, shapes), ~judged])
        errors = np.full_like(outputs, np.nan)
        for number in np.unique(muscles):
            own = muscles == number
            weights = np.linalg.lstsq(inputs[~own], outputs[~own])[0]
            errors[own] = outputs[own] - inputs[own] @ weights
        weights = np.linalg.lstsq(inputs, outputs)[0]
        errors = errors[judged]
        predicted = np.hstack([outputs[judged][:, :1] - errors[:, :1], beside])
        return cls(
            shapes=shapes,
            weights=weights[:-1],
            errors=errors,
            sizes=sizes_of_rows(predicted, errors),
            expected=ErrorSizes.fit(predicted, errors),
        )

    def infer(
        self,
        scaled: np.ndarray,
        beside: np.ndarray,
        columns: np.ndarray,
        values: np.ndarray,
        sds: np.ndarray,
    ) -> Posterior:
        """Return what is believed of K, as a posterior of one target.

        Args:
            scaled: a recording, shape (CURVES and ESTIMATES,).
            beside: what else sizes of errors go by, of this recording, shape (k,).
            columns: numbers of factors that were measured.
            values: their normal scores.
            sds: to which they were measured.
        """
        mean = _inputs(scaled[None], self.shapes)[0] @ self.weights
        chosen = np.concatenate([[0], 1 + columns]).astype(int)
        relative = (self.errors / self.sizes)[:, chosen]
        together = relative.T @ relative / len(relative)
        own = self.expected.at(np.concatenate([mean[:1], beside])[None])[0, chosen]
        covariance = own[:, None] * together * own
        surprise = values - mean[1 + columns]
        centre, spread = corrected(mean[:1], covariance, surprise, sds)
        noise = np.random.default_rng(0).standard_normal((len(relative), len(columns))) * sds
        sizes, errors = self.sizes[:, chosen], self.errors[:, chosen]
        covariances = sizes[:, :, None] * together * sizes[:, None, :]
        moved, spreads = corrected(
            np.zeros((len(errors), 1)), covariances, errors[:, 1:] + noise, sds
        )
        scores = np.sort((errors[:, :1] - moved) / spreads, axis=0)
        return Posterior(centre=centre, spread=spread, scores=scores)


def has_sets(bank: Bank) -> bool:
    """Say whether a bank's muscles are of two sets or more."""
    if MUSCLES not in bank.population.names:
        return False
    own = bank.bushing.factors[:, bank.population.names.index(MUSCLES)]
    return len(np.unique(own)) > 1


def any_muscles(
    bank: Bank, features: Features, sorted_factors: np.ndarray, contact: bool, beside: np.ndarray
) -> AnyMuscles | None:
    """Learn K whatever the muscles are, judged by the rows that intervals are calibrated on.

    `beside`: what else the sizes of these rows' errors go by, shape (rows, k).
    """
    if not has_sets(bank):
        return None
    parts = [bank.bushing, bank.contact] if contact else [bank.bushing]
    factors = np.vstack([part.factors for part in parts])
    truths = np.concatenate([targets_of(part)[:, :1] for part in parts])
    judged = np.repeat(np.arange(len(parts)) == len(parts) - 1, [len(part) for part in parts])
    return AnyMuscles.fit(
        features.scaled(np.vstack([noisy(bank, part) for part in parts])),
        np.hstack([truths, normal_scores(sorted_factors, factors)]),
        factors[:, bank.population.names.index(MUSCLES)],
        judged,
        beside,
    )


def _inputs(scaled: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    estimates = scaled[:, len(CURVES) : len(CURVES) + len(ESTIMATES)]
    return np.column_stack([np.ones(len(scaled)), estimates, scaled[:, :WINDOWS] @ shapes.T])
