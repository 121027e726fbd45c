"""Functions of the unit cube on which intervals of sensitivity indices are hard to get right."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit
from scipy.stats import qmc

from tests.testbed.functions.level_e import level_e
from tests.testbed.functions.scalar import KNOWN

Points = NDArray[np.float64]
Function = Callable[[Points], Points]

_SLOPES = np.array([4.0, 3.0, 2.0, 1.0, 0.5, 0.0])


@dataclass(frozen=True, kw_only=True)
class Hard:
    """A function and its true indices."""

    #: Of points (..., factors), returns (...).
    function: Function
    factors: int
    #: First- and total-order indices, shape (factors,); None: ask `sampled`.
    first: Points | None = None
    total: Points | None = None
    #: Whether nothing about it is hard, so that nobody should be warned.
    kind: bool = False

    def truth(self) -> tuple[Points, Points]:
        """Return the true first- and total-order indices."""
        if self.first is not None and self.total is not None:
            return self.first, self.total
        return sampled(self, 2**17 if self.factors < 12 else 2**14)


def sampled(hard: Hard, rows: int) -> tuple[Points, Points]:
    """Return S and ST from as many Sobol points (Saltelli et al. 2010; Jansen 1999)."""
    k = hard.factors
    base = qmc.Sobol(2 * k, scramble=True, rng=np.random.default_rng(1)).random(rows)
    a, b = base[:, :k], base[:, k:]
    f_a, f_b = hard.function(a), hard.function(b)
    variance = np.var(np.concatenate([f_a, f_b]))
    first, total = np.empty(k), np.empty(k)
    for i in range(k):
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        moved = hard.function(mixed) - f_a
        first[i] = np.mean((f_b - f_b.mean()) * moved) / variance
        total[i] = 0.5 * np.mean(moved**2) / variance
    return first, total


def product(shares: Points) -> tuple[Points, Points]:
    """Return S and ST of a product from V(g) / E(g)^2 of each part (Saltelli and Sobol 1995)."""
    whole = np.prod(1.0 + shares)
    return shares / (whole - 1.0), shares / (1.0 + shares) * whole / (whole - 1.0)


def additive(function: Function, parts: Sequence[float] | Points, *, kind: bool = False) -> Hard:
    """Return a sum of functions of one factor each, of these variances."""
    share = np.asarray(parts) / np.sum(parts)
    return Hard(function=function, factors=len(share), first=share, total=share, kind=kind)


def pareto(u: Points, exponent: float) -> Points:
    """Return a Pareto-tailed function of the first of six factors, and light ones beside it."""
    return (1.0 - u[..., 0]) ** -exponent + u[..., 1:] @ _LIGHT


_LIGHT = np.array([1.0, 0.8, 0.6, 0.4, 0.0])


def _pareto(exponent: float) -> Hard:
    variance = 1.0 / (1.0 - 2.0 * exponent) - 1.0 / (1.0 - exponent) ** 2
    return additive(partial(pareto, exponent=exponent), [variance, *(_LIGHT**2 / 12.0)])


def rare_event(u: Points) -> Points:
    """Return 1 where the first two of four factors are large, 0.015 of the cube, and a little."""
    return ((u[..., 0] > 0.97) & (u[..., 1] > 0.5)) + 0.05 * u[..., 2]


def _rare_event() -> Hard:
    p, q = 0.03, 0.5
    alone = np.array([q * q * p * (1 - p), p * p * q * (1 - q), 0.05**2 / 12.0, 0.0])
    pair = p * (1 - p) * q * (1 - q)
    variance = alone.sum() + pair
    company = alone + np.array([pair, pair, 0.0, 0.0])
    return Hard(function=rare_event, factors=4, first=alone / variance, total=company / variance)


def exp_sum(u: Points) -> Points:
    """Return the exponential of a weighted sum."""
    return np.asarray(np.exp(u @ _SLOPES))


def _exp_sum() -> Hard:
    a = _SLOPES[:-1]
    shares = np.append((np.expm1(2 * a) / (2 * a)) / (np.expm1(a) / a) ** 2 - 1.0, 0.0)
    first, total = product(shares)
    return Hard(function=exp_sum, factors=6, first=first, total=total)


def discontinuous(u: Points) -> Points:
    """Return steps: of sums, of one factor, and of two together; the last factor is idle."""
    steps = (u[..., 0] + u[..., 1] > 1.2) + 0.5 * (u[..., 2] > 0.9)
    return np.asarray(steps + 2.0 * ((u[..., 0] > 0.5) & (u[..., 3] < 0.3)))


def ties(u: Points) -> Points:
    """Return whole numbers, nine in ten of them 0; the last factor is idle."""
    return np.maximum(np.round(5.0 * u[..., 0] * u[..., 1] + 2.0 * u[..., 2] * u[..., 3] - 3.2), 0)


def offset(u: Points) -> Points:
    """Return Ishigami's function a million above 0."""
    return 1e6 + KNOWN["ishigami"].function(u)


def linear_20(u: Points) -> Points:
    """Return a weighted sum of twenty factors."""
    return np.asarray(u @ np.linspace(2.0, 0.1, 20))


def product_50(u: Points) -> Points:
    """Return Sobol's g-function of fifty factors, whose coefficients are 1, 2, ... 50."""
    a = np.arange(1.0, 51.0)
    return np.asarray(np.prod((np.abs(4.0 * u - 2.0) + a) / (1.0 + a), axis=-1))


def _product_50() -> Hard:
    first, total = product(1.0 / (3.0 * (1.0 + np.arange(1.0, 51.0)) ** 2))
    return Hard(function=product_50, factors=50, first=first, total=total, kind=True)


HARD: Mapping[str, Hard] = {
    **{
        name: Hard(
            function=known.function, factors=6, first=known.first, total=known.total, kind=True
        )
        for name, known in KNOWN.items()
    },
    "Pareto 0.2": _pareto(0.2),
    "Pareto 0.3": _pareto(0.3),
    "Pareto 0.4": _pareto(0.4),
    "rare event": _rare_event(),
    "level E, 50 000 years": Hard(function=partial(level_e, years=5e4), factors=12),
    "exp-sum": _exp_sum(),
    "discontinuity": Hard(function=discontinuous, factors=5),
    "heavy ties": Hard(function=ties, factors=5),
    "1e6 + Ishigami": Hard(
        function=offset,
        factors=6,
        first=KNOWN["ishigami"].first,
        total=KNOWN["ishigami"].total,
        kind=True,
    ),
    "linear, 20 factors": additive(linear_20, np.linspace(2.0, 0.1, 20) ** 2, kind=True),
    "Sobol's g, 50 factors": _product_50(),
}


def lognormal(u: Points) -> Points:
    """Return the exponential of 1.2 times a normal factor, and light ones beside it."""
    return np.asarray(np.exp(1.2 * ndtri(u[..., 0])) + u[..., 1:] @ _LIGHT)


def student(u: Points) -> Points:
    """Return a factor of Student's t with four degrees of freedom, a product, and one alone."""
    return np.asarray(stdtrit(4.0, u[..., 0]) + 2.0 * u[..., 1] * u[..., 2] + u[..., 3])


def resonance(u: Points) -> Points:
    """Return a peak of the first factor, which the second scales, and a third beside it."""
    peak = 1.0 / ((u[..., 0] - 0.5) ** 2 + 0.01)
    return np.asarray(peak * (1.0 + 0.5 * u[..., 1]) + 20.0 * u[..., 2])


def cascade(u: Points) -> Points:
    """Return one regime where the first factor is above 0.9, and another elsewhere."""
    return np.where(u[..., 0] > 0.9, 5.0 * u[..., 1] * u[..., 2], 0.2 * u[..., 3])


def needle(u: Points) -> Points:
    """Return ten in a corner of 0.027 of the cube, and a wave and a slope everywhere."""
    corner = np.all(u[..., :3] > 0.7, axis=-1)
    return np.asarray(10.0 * corner + np.sin(2.0 * np.pi * u[..., 3]) + 0.3 * u[..., 4])


#: On these nothing was set: they were written when all was done.
HELD_OUT: Mapping[str, Hard] = {
    "lognormal": additive(lognormal, [np.expm1(1.44) * np.exp(1.44), *(_LIGHT**2 / 12.0)]),
    "Student's t": Hard(function=student, factors=6),
    "resonance": Hard(function=resonance, factors=6),
    "cascade": Hard(function=cascade, factors=6),
    "needle": Hard(function=needle, factors=6),
}
