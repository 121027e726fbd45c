"""K_h and its like whatever the limb's muscles are: intervals for sets which the bank lacks, too.

A Gaussian process learns how the bank's muscles shape the torque, and a limb with others misleads
it. Here what is inferred is linear in what regressions say and in the movement, and how far it is
off is looked at with each set of muscles left out in turn: cross-validation by groups (Roberts et
al. 2017, Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic
structure). These errors, over how large they are to expect of such a recording, make the interval
(CV+: Barber et al. 2021, Predictive inference with the jackknife+).

What a regression says of a stiffness means another one for a short upper arm than for a long one:
slopes on regressions change with the arm's length. The length is told by a ridge regression (Hoerl
and Kennard 1970) of rows like the recording, as contact has it show otherwise; where it errs, or
is measured, K is off or right with it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.inference.error_sizes import ErrorSizes, sizes_of_rows
from analysis.interpretation.inference.features import Features
from analysis.interpretation.inference.posterior import TARGETS
from analysis.interpretation.inference.rows import in_deviations, noisy, targets_of
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
#: The factor with which slopes on regressions change.
LENGTH = "upper_arm_length"
#: Penalty on the slopes that tell the length, over inputs of variance 1. Of 0.01 to 3
#: it left the least of the length, and with 0.2 of K, where muscles were left out, on a bank's own
#: rows (seed 1).
PENALTY = 0.3


@dataclass(frozen=True, kw_only=True)
class AnyMuscles:
    """A linear model of the targets and of every factor, and its errors."""

    #: Of the scaled angle, shape (COMPONENTS, WINDOWS).
    shapes: np.ndarray
    #: What tells the length, of a constant and inputs, shape (1 + inputs,), and its column among
    #: targets and factors; 0 if the population has none.
    told: np.ndarray
    length: int
    #: Of a constant, ESTIMATES and the shapes, shape (1 + ESTIMATES + COMPONENTS, both), and of the
    #: length and of ESTIMATES times it, of the targets, shape (1 + ESTIMATES, TARGETS).
    slopes: np.ndarray
    with_length: np.ndarray
    #: Of targets, were the length known, and factors of rows whose muscles it was not told of,
    #: shape (rows, both); how large these are to expect, as the other rows tell it; and by how much
    #: the targets are off with the length, shape (rows, TARGETS).
    errors: np.ndarray
    sizes: np.ndarray
    pulls: np.ndarray
    #: How large they are: of K, and of the rest (`_sized_by`).
    of_stiffness: ErrorSizes
    of_others: ErrorSizes

    @classmethod
    def fit(
        cls,
        scaled: np.ndarray,
        inputs: np.ndarray,
        outputs: np.ndarray,
        muscles: np.ndarray,
        judged: np.ndarray,
        beside: np.ndarray,
        length: int,
    ) -> "AnyMuscles":
        """Learn from rows.

        Args:
            scaled: CURVES and ESTIMATES in units of the bank's, shape (n, both).
            inputs: what tells the length, of variance 1, shape (n, d).
            outputs: targets, and factors in standard deviations, shape (n, both).
            muscles: the number of each row's set, shape (n,).
            judged: rows whose errors make the interval, a mask: those with contact, which alone
                tell the length, and from which those without it differ as `_slopes` says.
            beside: what else the sizes of their errors go by, shape (judged rows, k).
            length: the column of LENGTH among `outputs`, 0 if there is none.
        """
        angle = scaled[:, :WINDOWS]
        shapes = np.linalg.svd(angle - angle.mean(axis=0), full_matrices=False)[2][:COMPONENTS]
        rows = np.column_stack([_inputs(scaled, shapes), ~judged])
        estimates = _estimates(scaled)
        lengths = outputs[:, length] if length else np.zeros(len(outputs))
        errors, pulls = np.full_like(outputs, np.nan), np.zeros((len(outputs), len(TARGETS)))
        for number in np.unique(muscles):
            own = muscles == number
            like = judged & ~own
            # Few rows with contact may all be of one set.
            like = like if like.any() else ~own
            told = _told(inputs[like], lengths[like])
            slopes, with_length = _slopes(rows[~own], estimates[~own], outputs[~own], lengths[~own])
            pulls[own] = _pull(estimates[own], with_length)
            errors[own] = outputs[own] - rows[own] @ slopes
            errors[own, : len(TARGETS)] -= lengths[own, None] * pulls[own]
            if length:
                errors[own, length] = lengths[own] - told[0] - inputs[own] @ told[1:]
        errors, pulls = errors[judged], pulls[judged]
        predicted = outputs[judged] - errors
        predicted[:, : len(TARGETS)] -= pulls * errors[:, [length]]
        first, others = _sized_by(predicted, scaled[judged], beside)
        sizes = [sizes_of_rows(first, errors[:, :1]), sizes_of_rows(others, errors[:, 1:])]
        slopes, with_length = _slopes(rows, estimates, outputs, lengths)
        return cls(
            shapes=shapes,
            told=_told(inputs[judged], lengths[judged]),
            length=length,
            slopes=slopes[:-1],
            with_length=with_length,
            errors=errors,
            sizes=np.hstack(sizes),
            pulls=pulls,
            of_stiffness=ErrorSizes.fit(first, errors[:, :1]),
            of_others=ErrorSizes.fit(others, errors[:, 1:]),
        )

    def look(self, scaled: np.ndarray, inputs: np.ndarray, beside: np.ndarray) -> View:
        """Return what a recording says.

        Args:
            scaled: a recording, shape (CURVES and ESTIMATES,).
            inputs: what tells the length, shape (d,).
            beside: what else sizes of errors go by, of this recording, shape (k,).
        """
        mean = _inputs(scaled[None], self.shapes) @ self.slopes
        length = float(self.told[0] + inputs @ self.told[1:])
        pull = _pull(_estimates(scaled[None]), self.with_length)
        mean[:, : len(TARGETS)] += length * pull
        if self.length:
            mean[:, int(self.length)] = length
        first, others = _sized_by(mean, scaled[None], beside[None])
        own = np.hstack([self.of_stiffness.at(first), self.of_others.at(others)])
        return View(mean=mean[0], covariance=self.rows.around(own, pull)[0], rows=self.rows)

    @cached_property
    def rows(self) -> RowErrors:
        """The errors, each beside how large it is to expect where it is."""
        return RowErrors(
            errors=self.errors,
            spreads=self.sizes,
            pulls=self.pulls,
            pulling=int(self.length),
            either_way=True,
        )


def has_sets(bank: Bank) -> bool:
    """Say whether a bank's muscles are of two sets or more."""
    if MUSCLES not in bank.population.names:
        return False
    own = bank.bushing.factors[:, bank.population.names.index(MUSCLES)]
    return len(np.unique(own)) > 1


def any_muscles(
    bank: Bank, features: Features, scale: np.ndarray, contact: bool, beside: np.ndarray
) -> AnyMuscles | None:
    """Learn targets whatever the muscles are, judged by the rows that make the intervals.

    Args:
        bank: with its rows.
        features: of its recordings.
        scale: mean and standard deviation of each factor, shape (2, factors).
        contact: whether rows with contact make the intervals.
        beside: what else the sizes of these rows' errors go by, shape (rows, k).
    """
    if not has_sets(bank):
        return None
    parts = [bank.bushing, bank.contact] if contact else [bank.bushing]
    factors = np.vstack([part.factors for part in parts])
    truths = np.concatenate([targets_of(part) for part in parts])
    judged = np.repeat(np.arange(len(parts)) == len(parts) - 1, [len(part) for part in parts])
    recorded = np.vstack([noisy(bank, part) for part in parts])
    names = bank.population.names
    return AnyMuscles.fit(
        features.scaled(recorded),
        features.inputs(recorded),
        np.hstack([truths, in_deviations(factors, scale)]),
        factors[:, names.index(MUSCLES)],
        judged,
        beside,
        len(TARGETS) + names.index(LENGTH) if LENGTH in names else 0,
    )


def _told(inputs: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return what tells a length, of a constant and of inputs (n, d), shape (1 + d,)."""
    from sklearn.linear_model import Ridge

    found = Ridge(alpha=PENALTY * len(inputs)).fit(inputs, length)
    return np.concatenate([[found.intercept_], found.coef_])


def _slopes(
    inputs: np.ndarray, estimates: np.ndarray, outputs: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return least squares' slopes on inputs, and those of targets on the known length, too.

    Each target changes with the length, and its slopes on estimates do; what contact changes does,
    too: it holds an arm that is too short or too long off the robot's axis. The last of `inputs`
    says that there is none. D is regressed on OF_DAMPING and on whether there is contact alone.

    Returns:
        Slopes on inputs, and of a constant and estimates times the length where there is contact.
    """
    slopes: np.ndarray = np.linalg.lstsq(inputs, outputs)[0]
    changing = np.column_stack([np.ones(len(inputs)), estimates, inputs[:, -1]]) * lengths[:, None]
    with_length = np.zeros((changing.shape[1], len(TARGETS)))
    few = np.array([1 + ESTIMATES.index(name) for name in OF_DAMPING])
    every = np.arange(inputs.shape[1]), np.arange(changing.shape[1])
    of_damping = np.array([0, *few, -1]), np.array([0, *few, -1])
    slopes[:, : len(TARGETS)] = 0.0
    for target in range(len(TARGETS)):
        own, more = of_damping if target == DAMPING else every
        found = np.linalg.lstsq(np.hstack([inputs[:, own], changing[:, more]]), outputs[:, target])[
            0
        ]
        slopes[own, target], with_length[more, target] = np.split(found, [len(own)])
    return slopes, with_length[:-1]


def _pull(estimates: np.ndarray, with_length: np.ndarray) -> np.ndarray:
    """Return by how much the targets change with the length, at estimates (n, k), (n, TARGETS)."""
    return np.asarray(with_length[0] + estimates @ with_length[1:])


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
