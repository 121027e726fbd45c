"""Functions of the unit cube that surrogates are usually compared on, and some that fool them.

Formulas and ranges are those of Surjanovic and Bingham 2013, Virtual library of simulation
experiments, unless a function says otherwise.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import ndtr, ndtri
from scipy.stats import triang

from tests.testbed.functions.hard import Hard
from tests.testbed.functions.scalar import noise

Points = NDArray[np.float64]


def _ranges(u: Points, *ends: tuple[float, float]) -> list[Points]:
    """Return each factor in its range."""
    return [low + (high - low) * u[..., i] for i, (low, high) in enumerate(ends)]


def _normal(u: Points, mean: float, sd: float, low: float = -np.inf) -> Points:
    """Return a normal factor, cut off below."""
    least = ndtr((low - mean) / sd)
    return np.asarray(mean + sd * ndtri(least + (1.0 - least) * u))


def morris(u: Points) -> Points:
    """Return Morris' function (1991) of twenty factors."""
    w = 2.0 * (u - 0.5)
    for i in (2, 4, 6):
        w[..., i] = 2.0 * (1.1 * u[..., i] / (u[..., i] + 0.1) - 0.5)
    alone = np.where(np.arange(20) < 10, 20.0, (-1.0) ** np.arange(1, 21))
    i, j = np.triu_indices(20, 1)
    pairs = np.where((i < 6) & (j < 6), -15.0, (-1.0) ** (i + j))
    y = w @ alone + (w[..., i] * w[..., j]) @ pairs
    first5 = w[..., :5]
    for a in range(5):
        for b in range(a + 1, 5):
            for c in range(b + 1, 5):
                y = y - 10.0 * first5[..., a] * first5[..., b] * first5[..., c]
    return np.asarray(y + 5.0 * np.prod(w[..., :4], axis=-1))


def borehole(u: Points) -> Points:
    """Return the flow of water through a borehole (Harper and Gupta 1983)."""
    radius = _normal(u[..., 0], 0.10, 0.0161812)
    reach = np.exp(7.71 + 1.0056 * ndtri(u[..., 1]))
    upper, high, lower, low, length, conductivity = _ranges(
        u[..., 2:],
        (63070, 115600),
        (990, 1110),
        (63.1, 116),
        (700, 820),
        (1120, 1680),
        (9855, 12045),
    )
    ratio = np.log(reach / radius)
    below = 1.0 + 2.0 * length * upper / (ratio * radius**2 * conductivity) + upper / lower
    return np.asarray(2.0 * np.pi * upper * (high - low) / (ratio * below))


def otl_circuit(u: Points) -> Points:
    """Return the midpoint voltage of a push-pull circuit (Ben-Ari and Steinberg 2007)."""
    b1, b2, f, c1, c2, beta = _ranges(
        u, (50, 150), (25, 70), (0.5, 3), (1.2, 2.5), (0.25, 1.2), (50, 300)
    )
    base, gain = 12.0 * b2 / (b1 + b2), beta * (c2 + 9.0)
    return np.asarray(
        (base + 0.74) * gain / (gain + f)
        + 11.35 * f / (gain + f)
        + 0.74 * f * gain / ((gain + f) * c1)
    )


def piston(u: Points) -> Points:
    """Return the cycle time of a piston (Kenett and Zacks 1998)."""
    mass, area, volume, spring, pressure, ambient, filling = _ranges(
        u,
        (30, 60),
        (0.005, 0.02),
        (0.002, 0.01),
        (1000, 5000),
        (9e4, 1.1e5),
        (290, 296),
        (340, 360),
    )
    a = pressure * area + 19.62 * mass - spring * volume / area
    root = np.sqrt(a**2 + 4.0 * spring * pressure * volume / filling * ambient)
    v = area / (2.0 * spring) * (root - a)
    stiffness = spring + area**2 * pressure * volume / filling * ambient / v**2
    return np.asarray(2.0 * np.pi * np.sqrt(mass / stiffness))


def wing_weight(u: Points) -> Points:
    """Return the weight of a light aircraft's wing (Forrester, Sobester and Keane 2008)."""
    area, fuel, aspect, sweep, q, taper, thick, load, gross, paint = _ranges(
        u, (150, 200), (220, 300), (6, 10), (-10, 10), (16, 45), (0.5, 1), (0.08, 0.18), (2.5, 6),
        (1700, 2500), (0.025, 0.08),
    )  # fmt: skip
    cosine = np.cos(np.radians(sweep))
    return np.asarray(
        0.036 * area**0.758 * fuel**0.0035 * (aspect / cosine**2) ** 0.6 * q**0.006 * taper**0.04
        * (100.0 * thick / cosine) ** -0.3 * (load * gross) ** 0.49 + area * paint
    )  # fmt: skip


def _triangle(u: Points, low: float, middle: float, high: float) -> Points:
    return np.asarray(triang.ppf(u, (middle - low) / (high - low), low, high - low))


def flood(u: Points) -> Points:
    """Return by how much a river overflows its dyke (Iooss and Lemaitre 2015)."""
    low, high = (np.exp(-np.exp(-(q - 1013.0) / 558.0)) for q in (500.0, 3000.0))
    flow = 1013.0 - 558.0 * np.log(-np.log(low + (high - low) * u[..., 0]))
    roughness = _normal(u[..., 1], 30.0, 8.0, 15.0)
    downstream, upstream = _triangle(u[..., 2], 49, 50, 51), _triangle(u[..., 3], 54, 55, 56)
    dyke = 7.0 + 2.0 * u[..., 4]
    bank = _triangle(u[..., 5], 55, 55.5, 56)
    length = _triangle(u[..., 6], 4990, 5000, 5010)
    width = _triangle(u[..., 7], 295, 300, 305)
    slope = np.sqrt((upstream - downstream) / length)
    return np.asarray(downstream + (flow / (width * roughness * slope)) ** 0.6 - dyke - bank)


def friedman(u: Points) -> Points:
    """Return Friedman's function (1991) without its noise; five factors of ten are idle."""
    bent = 10.0 * np.sin(np.pi * u[..., 0] * u[..., 1]) + 20.0 * (u[..., 2] - 0.5) ** 2
    return np.asarray(bent + 10.0 * u[..., 3] + 5.0 * u[..., 4])


def levy(u: Points) -> Points:
    """Return Levy's function of four factors, from -10 to 10."""
    w = 1.0 + (20.0 * u - 11.0) / 4.0
    inner = (w[..., :-1] - 1.0) ** 2 * (1.0 + 10.0 * np.sin(np.pi * w[..., :-1] + 1.0) ** 2)
    last = (w[..., -1] - 1.0) ** 2 * (1.0 + np.sin(2.0 * np.pi * w[..., -1]) ** 2)
    return np.asarray(np.sin(np.pi * w[..., 0]) ** 2 + inner.sum(axis=-1) + last)


def high_frequency(u: Points) -> Points:
    """Return a wave of forty periods, and a slope beside it."""
    return np.asarray(np.sin(80.0 * np.pi * u[..., 0]) + u[..., 1])


def jump_at_the_edge(u: Points) -> Points:
    """Return a slope, and a jump in the last twentieth of the first factor."""
    return np.asarray(u[..., 1] + 0.5 * u[..., 2] ** 2 + 2.0 * (u[..., 0] > 0.95))


def acts_in_a_corner(u: Points) -> Points:
    """Return a slope, and what the fourth factor does in 0.01 of the cube, a third of it all."""
    corner = (u[..., 0] > 0.9) & (u[..., 1] > 0.9)
    return np.asarray(u[..., 0] + u[..., 1] + 0.2 * u[..., 2] + 10.0 * corner * (u[..., 3] - 0.5))


def heavy_noise(u: Points) -> Points:
    """Return a slope beneath noise of as large a variance."""
    return np.asarray(u[..., 0] + 0.5 * u[..., 1] + 1.1 * noise(u))


def uneven_noise(u: Points) -> Points:
    """Return a slope, with noise that grows with the second factor."""
    return np.asarray(3.0 * u[..., 0] + u[..., 1] * (noise(u) - 0.5))


def little_noise(u: Points) -> Points:
    """Return Ishigami's function of three of six factors, and noise of a hundredth of it."""
    x = np.pi * (2.0 * u - 1.0)
    wave = np.sin(x[..., 0]) * (1.0 + 0.1 * x[..., 2] ** 4) + 7.0 * np.sin(x[..., 1]) ** 2
    return np.asarray(wave + 1.3 * (noise(u) - 0.5))


def pole_inside(power: float, share: float) -> Hard:
    """Return a sum of which |u2 - 0.4|^-power has a share of the variance: it has no end there."""
    sides, slopes = (0.4, 0.6), np.array([1.0, 0.7, 0.0, 0.0, 0.4, 0.0])
    mean, square = (
        sum(side ** (1.0 - p) for side in sides) / (1.0 - p) for p in (power, 2.0 * power)
    )
    linear = slopes**2 / 12.0
    scale = np.sqrt(share / (1.0 - share) * linear.sum() / (square - mean**2))
    index = (1.0 - share) * linear / linear.sum()
    index[2] = share

    def function(u: Points) -> Points:
        away = np.maximum(np.abs(u[..., 2] - sides[0]), 1e-14)
        return np.asarray(u @ slopes + scale * away**-power)

    return Hard(function=function, factors=6, first=index, total=index)


def two_poles_inside(power: float, share: float) -> Hard:
    """Return a sum of which |u2 - 0.3|^-power + |u2 - 0.7|^-power has a share of the variance."""
    places, slopes = (0.3, 0.7), np.array([1.0, 0.7, 0.0, 0.0, 0.4, 0.0])

    def poles(u: Points | float) -> Points:
        away = (np.maximum(np.abs(u - place), 1e-14) ** -power for place in places)
        return np.asarray(sum(away))

    mean, square = (
        quad(lambda u, n=n: float(poles(u)) ** n, 0.0, 1.0, points=places, limit=500)[0]
        for n in (1, 2)
    )
    linear = slopes**2 / 12.0
    scale = np.sqrt(share / (1.0 - share) * linear.sum() / (square - mean**2))
    index = (1.0 - share) * linear / linear.sum()
    index[2] = share

    def function(u: Points) -> Points:
        return np.asarray(u @ slopes + scale * poles(u[..., 2]))

    return Hard(function=function, factors=6, first=index, total=index)


def pole_in_a_corner(power: float, share: float) -> Hard:
    """Return a sum of which (u0 + u1)^-power has a share of the variance."""
    slopes = np.array([0.0, 0.0, 1.0, 0.7, 0.4, 0.1])

    def alone(a: float, p: float) -> float:
        """Return the mean of (a + b)^-p over b."""
        return float(((1.0 + a) ** (1.0 - p) - a ** (1.0 - p)) / (1.0 - p))

    mean, of_alone, square = (
        quad(lambda a, p=p, n=n: alone(a, p) ** n, 0.0, 1.0, limit=500)[0]
        for p, n in ((power, 1), (power, 2), (2.0 * power, 1))
    )
    linear = slopes**2 / 12.0
    variance = square - mean**2
    scale = np.sqrt(share / (1.0 - share) * linear.sum() / variance)
    first, total = (1.0 - share) * np.stack([linear, linear]) / linear.sum()
    first[:2] = share * (of_alone - mean**2) / variance
    total[:2] = share - first[:2]

    def function(u: Points) -> Points:
        return np.asarray(u @ slopes + scale * (u[..., 0] + u[..., 1]) ** -power)

    return Hard(function=function, factors=6, first=first, total=total)


def peak_in_a_corner(u: Points) -> Points:
    """Return 1 / (0.02 + u0 + u1), and slopes beside it."""
    return np.asarray(0.8 / (0.02 + u[..., 0] + u[..., 1]) + u[..., 2:] @ _BESIDE)


def peak_of_a_product(u: Points) -> Points:
    """Return 1 / (1.03 - u0 u1), and slopes beside it."""
    return np.asarray(0.9 / (1.03 - u[..., 0] * u[..., 1]) + u[..., 2:] @ _BESIDE)


_BESIDE = np.array([4.0, 3.0, 1.5, 0.5])

#: What a surrogate ought to answer.
SMOOTH: Mapping[str, Hard] = {
    "Morris": Hard(function=morris, factors=20),
    "borehole": Hard(function=borehole, factors=8),
    "OTL circuit": Hard(function=otl_circuit, factors=6),
    "piston": Hard(function=piston, factors=7),
    "wing weight": Hard(function=wing_weight, factors=10),
    "flood": Hard(function=flood, factors=8),
    "Friedman": Hard(function=friedman, factors=10),
    "Levy": Hard(function=levy, factors=4),
}

#: What it ought not to be sure of.
ROUGH: Mapping[str, Hard] = {
    "high frequency": Hard(function=high_frequency, factors=4),
    "jump at the edge": Hard(function=jump_at_the_edge, factors=4),
    "acts in a corner": Hard(function=acts_in_a_corner, factors=5),
    "heavy noise": Hard(function=heavy_noise, factors=6),
    "uneven noise": Hard(function=uneven_noise, factors=6),
    "little noise": Hard(function=little_noise, factors=6),
    "pole inside": pole_inside(0.3, 0.1),
    "mild pole inside": pole_inside(0.15, 0.5),
    "two poles inside": two_poles_inside(0.3, 0.1),
    "pole in a corner": pole_in_a_corner(0.6, 0.3),
    "mild pole in a corner": pole_in_a_corner(0.4, 0.3),
    "peak in a corner": Hard(function=peak_in_a_corner, factors=6),
    "peak of a product": Hard(function=peak_of_a_product, factors=6),
}
