"""Who may come: the wearers, interfaces, robots and limbs that a bank is drawn from.

One JSON file declares a population (`population.json` beside this module is the default), and a
clinic can replace it. Factors of one body are correlated: a Gaussian copula (Nelsen 2006, An
introduction to copulas, section 2.3) joins the distributions of single factors.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from analysis.designs.distributions import Discrete, Distribution
from analysis.designs.points import sobol
from analysis.interpretation.errors import InterpretationError
from analysis.json_values import is_finite_number
from models.factors import Factor
from sim.models import MODELS

#: The model that a population's factors belong to, and those of it that only contact has.
WITH_CONTACT, WITHOUT_CONTACT = "elbow_recording", "elbow_bushing_recording"


@dataclass(frozen=True, kw_only=True)
class Measure:
    """How a factor can be measured on a patient."""

    #: Standard deviation that is reached, in the factor's unit.
    to: float
    minutes: float
    how: str


@dataclass(frozen=True, kw_only=True)
class Population:
    """Distributions of factors, and how they go together."""

    name: str
    distributions: Mapping[str, Distribution]
    #: Correlation of the factors' normal scores, shape (factors, factors), in their order.
    correlation: np.ndarray
    #: How factors can be measured; those that nobody can measure are absent.
    measures: Mapping[str, Measure]
    #: Standard deviation of the zero error of each joint's torque, Nm.
    torque_zero: float
    #: Values of factors that are the same for everybody and not the model's own.
    fixed: Mapping[str, float]
    #: The file's content.
    content: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.distributions)

    @cached_property
    def _lower(self) -> np.ndarray:
        return np.linalg.cholesky(self.correlation)

    def units(self) -> dict[str, str]:
        """Return the unit of each factor."""
        known = _factors()
        return {name: known[name].unit for name in self.names}

    def unit_after(self, name: str) -> str:
        """Return a factor's unit as it follows a number; empty for a share."""
        unit = _factors()[name].unit
        return "" if unit == "1" else f" {unit}"

    def ends(self, name: str) -> tuple[float, float]:
        """Return between what a factor lies, in its unit; all but one in 10^9 where none is set."""
        low, high = self.distributions[name].ppf([1e-9, 1.0 - 1e-9])
        return float(low), float(high)

    def draw(self, seed: int, rows: np.ndarray) -> np.ndarray:
        """Return wearers of `seed` by their numbers, shape (len(rows), factors).

        Each is a pure function of seed and number, so that a bank can be extended. Points are of a
        scrambled Sobol sequence (`analysis.designs.points`).
        """
        count = len(self.names)
        unit = np.array([sobol(seed, int(row), count) for row in rows]).reshape(-1, count)
        probability = np.clip(ndtr(ndtri(unit) @ self._lower.T), 1e-12, 1.0 - 1e-12)
        columns = [d.ppf(probability[:, i]) for i, d in enumerate(self.distributions.values())]
        return np.column_stack(columns)

    def zero_errors(self, seed: int, rows: np.ndarray, joints: int) -> np.ndarray:
        """Return the zero errors of the torques of wearers, Nm, shape (len(rows), joints)."""
        return np.array(
            [
                np.random.default_rng([seed, int(row), 1]).normal(0.0, self.torque_zero, joints)
                for row in rows
            ]
        ).reshape(len(rows), joints)

    def is_discrete(self, name: str) -> bool:
        return isinstance(self.distributions[name], Discrete)


def default_population() -> Population:
    """Return the population that comes with rehyb."""
    text = files("analysis.interpretation.bank").joinpath("population.json").read_text("utf-8")
    return population_of(json.loads(text), "the default population")


def read_population(path: Path) -> Population:
    """Read a population from a JSON file.

    Raises:
        InterpretationError: it cannot be read, or means nothing.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InterpretationError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InterpretationError(f"{path} is no JSON: {error}") from None
    return population_of(content, str(path))


def population_of(content: Any, where: str) -> Population:
    """Return the population that `content` declares; `where` stands in errors.

    Raises:
        InterpretationError: it means nothing.
    """
    if not isinstance(content, dict) or content.get("schema") != 1:
        raise InterpretationError(
            f'{where} is no population: it must be an object with "schema": 1'
        )
    entries = content.get("factors")
    if not isinstance(entries, dict) or not entries:
        raise InterpretationError(f'{where} has no "factors"')
    known = _factors()
    distributions, measures = {}, {}
    for name, entry in entries.items():
        if name not in known:
            raise InterpretationError(
                f"{where}: {name!r} is no factor of {WITH_CONTACT}; "
                f"`rehyb model show {WITH_CONTACT}` lists them"
            )
        if not isinstance(entry, dict) or not entry.get("source"):
            raise InterpretationError(f"{where}: {name} needs a distribution and its source")
        distributions[name] = _distribution(entry.get("distribution"), known[name], where)
        if "measure" in entry and isinstance(distributions[name], Discrete):
            raise InterpretationError(
                f"{where}: {name} has single values, so no measure of it has a standard deviation"
            )
        if "measure" in entry:
            measures[name] = _measure(entry["measure"], name, where)
    sensors = content.get("sensors", {})
    torque_zero = sensors.get("torque_zero", {"sd": 0.0}) if isinstance(sensors, dict) else None
    zero = torque_zero.get("sd") if isinstance(torque_zero, dict) else None
    if zero is None or not is_finite_number(zero) or zero < 0.0:
        raise InterpretationError(f"{where}: sensors.torque_zero.sd must be a number, 0 or more")
    return Population(
        name=str(content.get("name", where)),
        distributions=distributions,
        correlation=_correlation(content.get("correlations", []), tuple(distributions), where),
        measures=measures,
        torque_zero=float(zero),
        fixed=_fixed(content.get("fixed", {}), distributions, where),
        content=content,
    )


def with_effects(population: Population, study: Mapping[str, Any], source: str) -> Population:
    """Return a population that has what closing the loop found, too.

    Args:
        population: as it was.
        study: of the found effects (`analysis.closeloop.report.effect_study`): factors with a range
            and fixed values.
        source: what found them, in words.

    Raises:
        InterpretationError: the simulation cannot carry one of them.
    """
    found = {
        factor["name"]: {
            "distribution": dict(
                zip(("kind", "low", "high"), ("uniform", *factor["range"]), strict=True)
            ),
            "source": source,
        }
        for factor in study["factors"]
        if "range" in factor
    }
    fixed = {**population.content.get("fixed", {}), **study["fixed"]}
    factors = {
        name: entry for name, entry in population.content["factors"].items() if name not in fixed
    }
    content = {**population.content, "factors": factors | found, "fixed": fixed}
    return population_of(content, f"{population.name} with {source}")


def _fixed(content: Any, sampled: Mapping[str, Any], where: str) -> dict[str, float]:
    known = _factors()
    if not isinstance(content, dict):
        raise InterpretationError(f'{where}: "fixed" is an object of factors and their values')
    for name, value in content.items():
        if name not in known:
            raise InterpretationError(f"{where}: {name!r} is no factor of {WITH_CONTACT}")
        if name in sampled:
            raise InterpretationError(f"{where}: {name} is both among the factors and fixed")
        low, high = known[name].reach
        if not is_finite_number(value) or not low <= value <= high:
            raise InterpretationError(
                f"{where}: {name} must be fixed at a number from {low:.4g} to {high:.4g}"
            )
    return {name: float(value) for name, value in content.items()}


def _factors() -> dict[str, Factor]:
    return {factor.name: factor for factor in MODELS[WITH_CONTACT].factors}


def _distribution(content: Any, factor: Factor, where: str) -> Distribution:
    try:
        found = Distribution.from_json(content if isinstance(content, dict) else {})
    except ValueError as error:
        raise InterpretationError(f"{where}: {factor.name}: {error}") from None
    if factor.choices and not (
        isinstance(found, Discrete) and set(found.values) <= set(range(len(factor.choices)))
    ):
        raise InterpretationError(
            f"{where}: {factor.name} is a choice: take a discrete distribution of 0 to "
            f"{len(factor.choices) - 1}, which are {', '.join(factor.choices)}"
        )
    ends = found.ppf([1e-9, 1.0 - 1e-9])
    low, high = factor.reach
    if not low <= ends[0] <= ends[1] <= high:
        raise InterpretationError(
            f"{where}: {factor.name} may be {ends[0]:.4g} to {ends[1]:.4g} {factor.unit}, but the "
            f"simulation means something from {low:.4g} to {high:.4g}: cut the distribution there"
        )
    return found


def _measure(content: Any, name: str, where: str) -> Measure:
    wanted = {"to", "minutes", "how"}
    if not isinstance(content, dict) or set(content) != wanted:
        raise InterpretationError(f"{where}: measure of {name} takes to, minutes and how")
    for key in ("to", "minutes"):
        if not is_finite_number(content[key]) or not content[key] > 0.0:
            raise InterpretationError(f"{where}: {key} of measure of {name} must be positive")
    return Measure(to=content["to"], minutes=content["minutes"], how=str(content["how"]))


def _correlation(pairs: Any, names: tuple[str, ...], where: str) -> np.ndarray:
    matrix = np.eye(len(names))
    said: list[set[str]] = []
    for pair in pairs if isinstance(pairs, list) else [None]:
        if not isinstance(pair, list) or len(pair) != 3 or not is_finite_number(pair[2]):
            raise InterpretationError(
                f"{where}: a correlation is [factor, factor, number], not {pair!r}"
            )
        one, other, value = pair
        if one not in names or other not in names or one == other or not -1.0 < value < 1.0:
            raise InterpretationError(
                f"{where}: {pair!r} must join two factors of the population by a number between "
                "-1 and 1"
            )
        i, j = names.index(one), names.index(other)
        if {one, other} in said:
            raise InterpretationError(
                f"{where}: {one} and {other} are a pair twice in the correlations: say it once"
            )
        said.append({one, other})
        matrix[i, j] = matrix[j, i] = value
    if np.linalg.eigvalsh(matrix).min() < 1e-9:
        raise InterpretationError(
            f"{where}: the correlations contradict each other (their matrix is not positive "
            "definite)"
        )
    return matrix
