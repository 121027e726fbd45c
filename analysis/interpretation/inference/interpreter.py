"""What a recording says of K_h and D_h: a mean by regression, an interval by conformal prediction.

First whatever the limb's muscles are (`any_muscles`); then, if they are one of the bank's sets:

1. A Gaussian process maps inputs to K, D, K over the angle and every factor of the population; a
   second one maps them to what contact changes about that.
2. Errors of prediction, each from all other rows, say how K and the factors err together around a
   recording. Whatever factor is then measured on the patient corrects K as in a linear Gaussian
   model (Rasmussen and Williams 2006, equation A.6).
3. Errors over their local spread have quantiles in the bank: a conformal predictive system
   (Vovk et al. 2019, Nonparametric predictive distributions based on conformal prediction).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.bank.population import Population
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.inference.any_muscles import AnyMuscles, any_muscles, has_sets
from analysis.interpretation.inference.familiarity import Familiarity, beyond
from analysis.interpretation.inference.features import Features
from analysis.interpretation.inference.fitted import arrays_of, built
from analysis.interpretation.inference.gaussian_process import GaussianProcess
from analysis.interpretation.inference.local_errors import NEIGHBOURS, LocalErrors
from analysis.interpretation.inference.posterior import TARGETS, Posterior, squared
from analysis.interpretation.inference.rows import in_deviations, noisy, targets_of
from analysis.interpretation.inference.view import View

#: Share of patients of whom what is known is said not to go with the recording.
CALLED_CONTRARY = 0.01
#: Fewest rows to learn from.
LEAST_ROWS = 4 * NEIGHBOURS
#: What is learnt, and of what kind it is.
PARTS: Mapping[str, Any] = {
    "features": Features,
    "familiarity": Familiarity,
    "first": GaussianProcess,
    "correction": GaussianProcess,
    "local": LocalErrors,
    "any_muscles": AnyMuscles,
}
#: Factors that errors are sized by, too, as they are predicted: an arm near the ends of lengths is
#: told less exactly. Chosen by the interval score of K on a bank's own rows, among both lengths
#: and both masses.
SIZED_BY = ("upper_arm_length",)
#: Fewest rows with contact from which its correction is learnt.
LEAST_CONTACT = 60


@dataclass(frozen=True, kw_only=True)
class Known:
    """A factor that was measured on the patient."""

    name: str
    value: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class Interpreter:
    """What was learnt from a bank."""

    population: Population
    features: Features
    #: From inputs to targets and factors, these in standard deviations.
    first: GaussianProcess
    #: To what contact adds; None without contact in the bank.
    correction: GaussianProcess | None
    #: Of the rows that intervals are calibrated on.
    local: LocalErrors
    #: What recordings have in common.
    familiarity: Familiarity
    #: Whatever the muscles are; None if the population has one set of them only.
    any_muscles: AnyMuscles | None
    #: Mean and standard deviation of each factor, in its unit, shape (2, factors).
    factor_scale: np.ndarray

    @classmethod
    def fit(cls, bank: Bank, like: "Interpreter | None" = None) -> "Interpreter":
        """Learn from a bank.

        Args:
            bank: with its rows.
            like: learnt from the same rows without contact, which need not be learnt from again.

        Raises:
            InterpretationError: it holds too few recordings.
        """
        if len(bank.bushing) < LEAST_ROWS:
            raise InterpretationError(
                f"a bank needs {LEAST_ROWS} recordings that can be believed, and this one has "
                f"{len(bank.bushing)}: build it with more --rows"
            )
        factors = bank.bushing.factors
        scale = np.array([factors.mean(axis=0), np.maximum(factors.std(axis=0), 1e-12)])
        recorded = noisy(bank, bank.bushing)
        features = Features.fit(recorded) if like is None else like.features
        inputs = features.inputs(recorded)
        tuned = len(TARGETS)
        outputs = np.hstack([targets_of(bank.bushing), in_deviations(factors, scale)])
        if like is None:
            first = GaussianProcess.fit(inputs, outputs, tuned=tuned, seed=bank.seed)
        else:
            first = like.first
        errors, correction = first.residuals, None
        looked_at = recorded
        if len(bank.contact) >= LEAST_CONTACT:
            looked_at = noisy(bank, bank.contact)
            inputs = features.inputs(looked_at)
            outputs = np.hstack(
                [targets_of(bank.contact), in_deviations(bank.contact.factors, scale)]
            )
            correction = GaussianProcess.fit(
                inputs, outputs - first.predict(inputs), tuned=tuned, seed=bank.seed
            )
            errors = correction.residuals
        sized_by = (outputs - errors)[:, _sizing(bank.population)]
        return cls(
            population=bank.population,
            features=features,
            first=first,
            correction=correction,
            local=LocalErrors.fit(inputs / first.lengths, sized_by, errors),
            familiarity=Familiarity.fit(features.scaled(looked_at)),
            any_muscles=any_muscles(
                bank, features, scale, correction is not None, sized_by[:, tuned:]
            ),
            factor_scale=scale,
        )

    @cached_property
    def arrays(self) -> dict[str, np.ndarray]:
        """Return what `Interpreter.read` needs."""
        found = {"factor_scale": self.factor_scale}
        for name in PARTS:
            if (part := getattr(self, name)) is not None:
                found |= dict(arrays_of(part, name))
        return found

    @classmethod
    def read(cls, bank: Bank) -> "Interpreter":
        """Return what was learnt from a bank when it was built.

        Raises:
            InterpretationError: an array is missing.
        """
        absent = set() if has_sets(bank) else {"any_muscles"}
        if not any(name.startswith("correction.") for name in bank.fitted):
            absent.add("correction")
        try:
            parts: dict[str, Any] = {
                name: None if name in absent else built(kind, bank.fitted, name)
                for name, kind in PARTS.items()
            }
            return cls(
                population=bank.population,
                factor_scale=bank.fitted["factor_scale"],
                **parts,
            )
        except KeyError as missing:
            raise InterpretationError(
                f"what was learnt from this bank has no {missing.args[0]}: `rehyb bank build "
                f"--extend --rows {bank.bushing.drawn} --contact-rows {bank.contact.drawn}` "
                "learns again"
            ) from None

    def inputs(self, recorded: np.ndarray) -> np.ndarray:
        """Return the inputs of recordings, shape (n, d)."""
        return self.features.inputs(recorded)

    def stiffness(self, recorded: np.ndarray) -> np.ndarray:
        """Return K by regression alone of recordings (n, both), Nm/rad, shape (n,)."""
        return self._mean(self.inputs(recorded))[:, 0]

    def look(self, recorded: np.ndarray) -> View:
        """Return what a recording (CURVES and ESTIMATES, shape (both,)) says before calibration.

        It says so whatever the limb's muscles are, unless the bank has one set of them only.
        """
        if self.any_muscles is None:
            return self.look_by_sets(recorded)
        scaled = self.features.scaled(recorded[None])[0]
        inputs = self.inputs(recorded[None])
        beside = self._mean(inputs)[0, _sizing(self.population)]
        return self.any_muscles.look(scaled, inputs[0], beside[len(TARGETS) :])

    def look_by_sets(self, recorded: np.ndarray) -> View:
        """Return what a recording says if the limb's muscles are one of the bank's sets."""
        inputs = self.inputs(recorded[None])
        mean = self._mean(inputs)
        sized_by = mean[:, _sizing(self.population)]
        around = self.local.around(inputs / self.first.lengths, sized_by)
        return View(mean=mean[0], covariance=around[0], rows=self.local.rows)

    def infer(self, view: View, known: tuple[Known, ...] = ()) -> Posterior:
        """Return what is believed after a recording and what was measured on the patient.

        Raises:
            InterpretationError: a known value is impossible in this population.
        """
        return view.posterior(*self._measured(known))

    def surprise(self, view: View, known: tuple[Known, ...]) -> tuple[float, float, int]:
        """Return how far what is known is from what a recording says of it.

        Returns:
            The squared distance, that beyond which CALLED_CONTRARY of the bank's rows are if they
            are measured alike, and which of `known` is farthest by itself.
        """
        columns, values, sds = self._measured(known)
        away, count = values - view.mean[columns], len(TARGETS)
        own = view.covariance[np.ix_(columns, columns)] + np.diag(sds**2)
        errors, every = view.rows.as_measured(columns, sds)
        distances = squared(errors, every[:, count:, count:] + np.diag(sds**2))
        worst = int(np.argmax(np.abs(away) / np.sqrt(np.diag(own))))
        limit = beyond(np.sort(distances), CALLED_CONTRARY)
        return float(squared(away[None], own[None])[0]), limit, worst

    def after(self, view: View, known: tuple[Known, ...], sds: Mapping[str, float]) -> Posterior:
        """Return what to expect if factors were measured, too, to standard deviations `sds`.

        The centre is what is believed now: a measurement moves it, but nobody knows whither.
        """
        columns, values, own = self._measured(known)
        now = view.posterior(columns, values, own)
        more, scaled = self.measurable(sds)
        columns, scaled = np.concatenate([columns, more]), np.concatenate([own, scaled])
        return replace(view.posterior(columns, np.zeros(len(columns)), scaled), centre=now.centre)

    def measurable(self, sds: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return columns of factors, and standard deviations over the factors' own."""
        columns = np.array([self._column(name) for name in sds], dtype=int)
        return columns, _scaled(list(sds.values()), self._scale(columns))

    def measured(self, known: tuple[Known, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return columns of what is known, and standard deviations over the factors' own."""
        columns, _, sds = self._measured(known)
        return columns, sds

    def _mean(self, inputs: np.ndarray) -> np.ndarray:
        mean = self.first.predict(inputs)
        return mean if self.correction is None else mean + self.correction.predict(inputs)

    def _measured(self, known: tuple[Known, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return columns, values and standard deviations of what is known, over the factors'."""
        columns = np.array([self._column(one.name) for one in known], dtype=int)
        for one in known:
            self._check(one)
        scale = self._scale(columns)
        values = in_deviations(np.array([one.value for one in known]), scale)
        return columns, values, _scaled([one.sd for one in known], scale)

    def _check(self, one: Known) -> None:
        """Refuse what says nothing, or cannot be in this population."""
        reach, (low, high) = 2.0 * one.sd, self.population.ends(one.name)
        # Beside a larger one the factor's own spread is all there is; squared, it may overflow.
        tells, possible = one.sd <= high - low, low - reach <= one.value <= high + reach
        if tells and possible:
            return
        unit = self.population.unit_after(one.name)
        population = f"in this bank's population it is {low:.4g} to {high:.4g}{unit}"
        if not tells:
            raise InterpretationError(
                f"{one.name} to {one.sd:g}{unit} says nothing: {population}; leave it out"
            )
        raise InterpretationError(
            f"{one.name} cannot be {one.value:g}{unit}: {population}, and a reading may be 2 "
            "standard deviations beyond"
        )

    def _column(self, name: str) -> int:
        """Return where a factor is among targets and factors.

        Raises:
            InterpretationError: it is none, or nobody can measure it as a number.
        """
        if name not in self.population.names:
            names = ", ".join(
                n for n in self.population.names if not self.population.is_discrete(n)
            )
            raise InterpretationError(
                f"there is no {name!r} to be known: this bank's population has {names}"
            )
        if self.population.is_discrete(name):
            raise InterpretationError(f"{name} is a choice, which nobody measures: leave it out")
        return len(TARGETS) + self.population.names.index(name)

    def _scale(self, columns: np.ndarray) -> np.ndarray:
        """Return mean and standard deviation of the factors in `columns`, shape (2, columns)."""
        return self.factor_scale[:, columns - len(TARGETS)]


def _scaled(sds: list[float], scale: np.ndarray) -> np.ndarray:
    """Return standard deviations over those of the factors; none is exact."""
    return np.asarray(np.maximum(np.array(sds) / scale[1], 1e-3))


def _sizing(population: Population) -> list[int]:
    """Return what sizes of errors go by: the targets, and where SIZED_BY stand beside them."""
    known = [population.names.index(name) for name in SIZED_BY if name in population.names]
    return [*range(len(TARGETS)), *(len(TARGETS) + number for number in known)]
