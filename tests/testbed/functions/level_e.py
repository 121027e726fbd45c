"""Level E: what a repository of nuclear waste gives off, the classic hard case of the field.

Nuclides leave a canister and travel through two layers of rock, iodine alone and neptunium,
uranium and thorium as a chain (OECD/NEA PSAG 1989; ranges and constants after Saltelli, Tarantola
and Campolongo 2000, Sensitivity analysis as an ingredient of modeling, table 1). The transport
equations are linear, so they are solved in Laplace space, where a layer of length l multiplies
the flux by exp(l (1 - sqrt(1 + 4 d m / v)) / (2 d)) for each eigenvalue m of retention and decay,
and inverted by Talbot's contour (Trefethen, Weideman and Schmelzer 2006, Talbot quadratures and
rational approximations).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FACTORS = 12
#: When the dose is taken: a few runs in ten thousand then give most of it.
YEARS = 2e5

_LOW = np.array([100, 1e-3, 1e-6, 1e-3, 100, 1, 3, 1e-2, 50, 1, 3, 1e5])
_HIGH = np.array([1000, 1e-2, 1e-5, 1e-1, 500, 5, 30, 1e-1, 200, 5, 30, 1e7])
_LOGARITHMIC = np.array([0, 1, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1], dtype=bool)

#: Of iodine, neptunium, uranium and thorium: decay per year, moles at first, dose per mole, and how
#: many times the factor's retention.
_DECAY = np.array([4.41e-8, 3.24e-7, 4.37e-6, 9.44e-5])
_MOLES = np.array([100.0, 1000.0, 100.0, 1000.0])
_DOSE = np.array([56.0, 6.8e3, 5.9e3, 1.8e6])
_RETAINED = np.array([1.0, 100.0, 10.0, 100.0])
_DISPERSION = (10.0, 5.0)
_WATER = 0.73

_NODES = 24
_AT_ONCE = 4096


def level_e(u: Array, years: float = YEARS) -> Array:
    """Return the dose per year (Sv) after `years` of points (..., 12) of the unit cube."""
    flat = u.reshape(-1, FACTORS)
    parts = [
        _dose(flat[start : start + _AT_ONCE], years) for start in range(0, len(flat), _AT_ONCE)
    ]
    return np.concatenate(parts).reshape(u.shape[:-1])


def _dose(u: Array, years: float) -> Array:
    linear = _LOW + u * (_HIGH - _LOW)
    x = np.where(_LOGARITHMIC, np.exp(np.log(_LOW) + u * np.log(_HIGH / _LOW)), linear)
    held, k_i, k_c, v1, l1, ri1, rc1, v2, l2, ri2, rc2, stream = x.T[:, None, :]
    passed = years - held[0]
    s, weight = _contour(passed)
    start = _after_decay(held[0])
    layers = ((v1, l1, ri1, rc1, _DISPERSION[0]), (v2, l2, ri2, rc2, _DISPERSION[1]))
    iodine = k_i * start[0] / (s + _DECAY[0] + k_i)
    for v, length, r, _, d in layers:
        iodine = iodine * _passage(r * (s + _DECAY[0]), v, length, d)
    chain = []
    for n in (1, 2, 3):
        fed = start[n] + (_DECAY[n - 1] * chain[-1] if chain else 0.0)
        chain.append(fed / (s + _DECAY[n] + k_c))
    flux = [k_c * moles for moles in chain]
    for v, length, _, rc, d in layers:
        flux = _through(flux, rc, s, v, length, d)
    total = sum(_DOSE[n] * f for n, f in zip((1, 2, 3), flux, strict=True)) + _DOSE[0] * iodine
    per_year = np.maximum(np.real(weight * total).sum(axis=0), 0.0)
    return np.asarray(per_year * _WATER / stream[0])


def _contour(time: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return nodes and weights, shape (nodes, runs), of the inverse transform at `time`."""
    theta = (2.0 * np.arange(_NODES) + 1.0) * np.pi / _NODES - np.pi
    theta = theta[_NODES // 2 :, None]  # the other half is the conjugate
    scale = _NODES / time
    z = scale * (0.5017 * theta / np.tan(0.6407 * theta) - 0.6122 + 0.2645j * theta)
    slope = 0.5017 / np.tan(0.6407 * theta) + 0.2645j
    slope = scale * (slope - 0.5017 * 0.6407 * theta / np.sin(0.6407 * theta) ** 2)
    return z, 2.0 * np.exp(z * time) * slope / (1j * _NODES)


def _after_decay(years: Array) -> list[Array]:
    """Return moles of the four nuclides when the canister opens (Bateman 1910)."""
    a, b, c = _DECAY[1:]
    e = [np.exp(-decay * years) for decay in (a, b, c)]
    iodine = _MOLES[0] * np.exp(-_DECAY[0] * years)
    np_, u_, th = _MOLES[1:]
    uranium = u_ * e[1] + np_ * a / (b - a) * (e[0] - e[1])
    of_np = a * b * (e[0] / ((b - a) * (c - a)) + e[1] / ((a - b) * (c - b)))
    of_np = of_np + a * b * e[2] / ((a - c) * (b - c))
    thorium = th * e[2] + u_ * b / (c - b) * (e[1] - e[2]) + np_ * of_np
    return [iodine, np_ * e[0], uranium, thorium]


def _passage(m: Array, v: Array, length: Array, d: float) -> Array:
    """Return by what a layer multiplies the flux of what is retained and decays by `m`."""
    return np.exp(length * (1.0 - np.sqrt(1.0 + 4.0 * d * m / v)) / (2.0 * d))


def _through(flux: list[Array], rc: Array, s: Array, v: Array, length: Array, d: float) -> list:
    """Return the chain's flux behind a layer: a function of a triangular matrix, entry by entry."""
    m = [_RETAINED[n] * rc * (s + _DECAY[n]) for n in (1, 2, 3)]
    f = [_passage(one, v, length, d) for one in m]
    fed = [_RETAINED[n] * rc * _DECAY[n] for n in (1, 2)]
    f01, f12 = _slope(f, m, 0, 1), _slope(f, m, 1, 2)
    twice = (f12 - f01) / (m[2] - m[0])
    # What enters per unit of concentration is retained: entries below the diagonal are -fed.
    first = flux[0] * f[0]
    second = flux[1] * f[1] - flux[0] * fed[0] * f01
    third = flux[2] * f[2] - flux[1] * fed[1] * f12 + flux[0] * fed[0] * fed[1] * twice
    return [first, second, third]


def _slope(f: list[Array], m: list[Array], i: int, j: int) -> Array:
    return (f[j] - f[i]) / (m[j] - m[i])
