"""K_h and its like whatever the limb's muscles are: intervals for sets which the bank lacks, too.

A Gaussian process learns how the bank's muscles shape the torque, and a limb with others misleads
it. Here what is inferred is linear in what regressions say and in the movement, and how far it is
off is looked at with each set of muscles left out in turn: cross-validation by groups (Roberts et
al. 2017, Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic
structure). These errors, over how large they are to expect of such a recording, make the interval
(CV+: Barber et al. 2021, Predictive inference with the jackknife+).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.inference.error_sizes import ErrorSizes, sizes_of_rows
from analysis.interpretation.inference.features import Features
from analysis.interpretation.inference.posterior import TARGETS
from analysis.interpretation.inference.rows import noisy, normal_scores, targets_of
from analysis.interpretation.inference.view import RowErrors, View
from sim.models import CURVES, ESTIMATES, WINDOWS

#: Principal components of the elbow's angle over time that are looked at.
COMPONENTS = 6
#: What D is regressed on, beside a constant: with all the rest errors for muscles that were left
#: out are a third larger on the bank's own rows, where this was chosen (seed 1).
OF_DAMPING = ("affine_stiffness", "affine_damping")
DAMPING = TARGETS.index("damping")
#: The factor whose values are left out in turn.
MUSCLES = "muscles"


@dataclass(frozen=True, kw_only=True)
class AnyMuscles:
    """A linear model of the targets and of every factor, and its errors."""

    #: Of the scaled angle, shape (COMPONENTS, WINDOWS).
    shapes: np.ndarray
    #: Of a constant, ESTIMATES and the shapes, shape (1 + ESTIMATES + COMPONENTS, both).
    slopes: np.ndarray
    #: Of targets and factors of rows whose muscles it was not told of, shape (rows, both), and how
    #: large these are to expect, as the other rows tell it.
    errors: np.ndarray
    sizes: np.ndarray
    #: How large they are: of K, and of the rest (`_sized_by`).
    of_stiffness: ErrorSizes
    of_others: ErrorSizes

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
            outputs: targets and the factors' normal scores, shape (n, both).
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
            errors[own] = outputs[own] - inputs[own] @ _slopes(inputs[~own], outputs[~own])
        errors = errors[judged]
        first, others = _sized_by(outputs[judged] - errors, scaled[judged], beside)
        sizes = [sizes_of_rows(first, errors[:, :1]), sizes_of_rows(others, errors[:, 1:])]
        return cls(
            shapes=shapes,
            slopes=_slopes(inputs, outputs)[:-1],
            errors=errors,
            sizes=np.hstack(sizes),
            of_stiffness=ErrorSizes.fit(first, errors[:, :1]),
            of_others=ErrorSizes.fit(others, errors[:, 1:]),
        )

    def look(self, scaled: np.ndarray, beside: np.ndarray) -> View:
        """Return what a recording says.

        Args:
            scaled: a recording, shape (CURVES and ESTIMATES,).
            beside: what else sizes of errors go by, of this recording, shape (k,).
        """
        mean = _inputs(scaled[None], self.shapes) @ self.slopes
        first, others = _sized_by(mean, scaled[None], beside[None])
        own = np.hstack([self.of_stiffness.at(first), self.of_others.at(others)])
        return View(mean=mean[0], covariance=self.rows.around(own)[0], rows=self.rows)

    @cached_property
    def rows(self) -> RowErrors:
        """The errors, each beside how large it is to expect where it is."""
        return RowErrors(errors=self.errors, spreads=self.sizes)


def has_sets(bank: Bank) -> bool:
    """Say whether a bank's muscles are of two sets or more."""
    if MUSCLES not in bank.population.names:
        return False
    own = bank.bushing.factors[:, bank.population.names.index(MUSCLES)]
    return len(np.unique(own)) > 1


def any_muscles(
    bank: Bank, features: Features, sorted_factors: np.ndarray, contact: bool, beside: np.ndarray
) -> AnyMuscles | None:
    """Learn targets whatever the muscles are, judged by the rows that make the intervals.

    `beside`: what else the sizes of these rows' errors go by, shape (rows, k).
    """
    if not has_sets(bank):
        return None
    parts = [bank.bushing, bank.contact] if contact else [bank.bushing]
    factors = np.vstack([part.factors for part in parts])
    truths = np.concatenate([targets_of(part) for part in parts])
    judged = np.repeat(np.arange(len(parts)) == len(parts) - 1, [len(part) for part in parts])
    return AnyMuscles.fit(
        features.scaled(np.vstack([noisy(bank, part) for part in parts])),
        np.hstack([truths, normal_scores(sorted_factors, factors)]),
        factors[:, bank.population.names.index(MUSCLES)],
        judged,
        beside,
    )


def _slopes(inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
    """Return least squares' slopes; of D on OF_DAMPING and on whether there is contact alone."""
    slopes: np.ndarray = np.linalg.lstsq(inputs, outputs)[0]
    own = [0, *(1 + ESTIMATES.index(name) for name in OF_DAMPING), inputs.shape[1] - 1]
    slopes[:, DAMPING] = 0.0
    slopes[own, DAMPING] = np.linalg.lstsq(inputs[:, own], outputs[:, DAMPING])[0]
    return slopes


def _sized_by(
    predicted: np.ndarray, scaled: np.ndarray, beside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what sizes of errors of K go by, and of all else, each shape (n, k).

    Targets as they are predicted, `beside`, and for K what regressions say, of which the residual
    and the damping show co-contraction. Chosen by the interval score of each set of muscles left
    out of the rest, on the bank's own rows (seed 1): D of a set with other damping was held too
    seldom if its sizes went by regressions.
    """
    every = np.hstack([predicted[:, : len(TARGETS)], beside])
    return np.hstack([every, _estimates(scaled)]), every


def _inputs(scaled: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    return np.column_stack(
        [np.ones(len(scaled)), _estimates(scaled), scaled[:, :WINDOWS] @ shapes.T]
    )


def _estimates(scaled: np.ndarray) -> np.ndarray:
    return scaled[:, len(CURVES) : len(CURVES) + len(ESTIMATES)]
