"""Whether intervals hold what they say, on wearers whom the bank has never seen.

Simulation-based calibration (Talts et al. 2018, Validating Bayesian inference algorithms with
simulation-based calibration): the rank of the truth in what is believed is uniform, in every
subgroup.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import kstest

from analysis.interpretation.bank.bank import Samples
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.posterior import TARGETS
from analysis.interpretation.inference.rows import targets_of
from analysis.interpretation.inference.view import View

#: What an interpreter says of a recording.
Look = Callable[[Interpreter, np.ndarray], View]
#: Sets of muscles, by their numbers.
MUSCLES = ("paper", "holzbaur2005", "physiological")


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What was believed of n wearers, and what is true."""

    #: Share of the belief below the truth, shape (n, TARGETS).
    ranks: np.ndarray
    #: Half width of the 90 % interval, shape (n, TARGETS).
    half_widths: np.ndarray
    #: Median less truth, shape (n, TARGETS).
    errors: np.ndarray

    def coverage(self, chosen: np.ndarray, share: float = 0.9, target: int = 0) -> float:
        """Return how often intervals of `share` hold the truth among the `chosen` (a mask)."""
        rank = self.ranks[chosen, target]
        return float(np.mean((rank > (1 - share) / 2) & (rank < (1 + share) / 2)))

    def uniformity(self, target: int = 0) -> float:
        """Return the p-value of ranks that are uniform (Kolmogorov and Smirnov)."""
        return float(kstest(self.ranks[:, target], "uniform").pvalue)


def judge(
    interpreter: Interpreter,
    samples: Samples,
    zero_errors: np.ndarray,
    known: Mapping[str, float] | None = None,
    seed: int = 0,
    look: Look = Interpreter.look,
) -> Judged:
    """Interpret every recording of `samples`, with `zero_errors` (n, joints) of its sensors.

    Args:
        interpreter: of a bank without these wearers.
        samples: with their truth.
        zero_errors: Nm.
        known: factors that are measured on each, and to which standard deviation.
        seed: of what these measurements are off by.
        look: `Interpreter.look_by_sets` for what is said if the muscles are one of the bank's sets.
    """
    recorded = samples.curves(zero_errors)
    truths, names = targets_of(samples), interpreter.population.names
    assert recorded.shape[1] == len(RECORDED)
    rng = np.random.default_rng(seed)
    ranks, widths, errors = [], [], []
    for row, (values, truth) in enumerate(zip(recorded, truths, strict=True)):
        measured = tuple(
            Known(
                name=name,
                value=_within(interpreter, name, samples.factors[row, names.index(name)], sd, rng),
                sd=sd,
            )
            for name, sd in (known or {}).items()
        )
        posterior = interpreter.infer(look(interpreter, values), measured)
        ranks.append(posterior.rank(truth))
        widths.append([posterior.half_width(target) for target in range(len(TARGETS))])
        errors.append(posterior.quantiles(np.array([0.5]))[0] - truth)
    return Judged(ranks=np.array(ranks), half_widths=np.array(widths), errors=np.array(errors))


def subgroups(interpreter: Interpreter, samples: Samples) -> dict[str, np.ndarray]:
    """Return the wearers of each subgroup as masks: a third of the population, or the spastic."""
    names = interpreter.population.names

    def factor(name: str) -> np.ndarray:
        return np.asarray(samples.factors[:, names.index(name)])

    def third(name: str, which: str) -> np.ndarray:
        low, high = interpreter.population.distributions[name].ppf([1 / 3, 2 / 3])
        return np.asarray(factor(name) < low if which == "low" else factor(name) > high)

    stiffness = targets_of(samples)[:, 0]
    return {
        "all": np.ones(len(samples), dtype=bool),
        "short upper arm": third("upper_arm_length", "low"),
        "long upper arm": third("upper_arm_length", "high"),
        "weak": third("muscle_strength", "low"),
        "strong": third("muscle_strength", "high"),
        "relaxed": third("activation", "low"),
        "co-contracting": third("activation", "high"),
        "with a reflex": factor("reflex_gain") > 0.0,
        "compliant, K below 2": stiffness < 2.0,
        "spastic, K above 6": stiffness > 6.0,
        **{f"muscles {name}": factor("muscles") == number for number, name in enumerate(MUSCLES)},
    }


def _within(
    interpreter: Interpreter, name: str, value: float, sd: float, rng: np.random.Generator
) -> float:
    """Return a measured value, within what the population can have."""
    low, high = interpreter.population.ends(name)
    return float(np.clip(value + sd * rng.standard_normal(), low - sd, high + sd))
