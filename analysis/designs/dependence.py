"""Factors that depend on each other: a Gaussian copula over their distributions.

Each factor keeps its own distribution; a correlation of every pair, of ranks or of values, is that
of normal variables of which the factors are made (Cario and Nelson 1997, Modeling and generating
random vectors with arbitrary marginal distributions and correlation matrix). Not every table of
correlations is possible: the nearest one that is, is named (Higham 2002, Computing the nearest
correlation matrix).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from analysis.designs.distributions import Discrete, Distribution

Array = NDArray[np.float64]

#: Of the ranks (Spearman 1904), or of the values (Pearson 1895).
KINDS = ("rank", "linear")
#: The least eigenvalue that a matrix of correlations may have: below, some factor is all but a
#: function of the others, and what it does without them is noise.
LEAST_EIGENVALUE = 1e-3
#: Decimals of the correlations that sentences name.
_DECIMALS = 3
#: Steps of Higham's projections; a dozen bring what people write within a thousandth.
_PROJECTIONS = 500
#: Nodes of the quadrature of a linear correlation, and halvings of the interval it is sought in.
_NODES, _HALVINGS = 48, 50
#: Equally likely parts of a normal variable, where a factor is discrete.
_STRATA = 200
#: Values strictly between 0 and 1.
_LEAST, _MOST = 2.0**-53, 1.0 - 2.0**-53

Pair = tuple[str, str, float]


class DependenceError(ValueError):
    """Correlations are not possible; the message says which, and what the nearest possible are.

    Attributes:
        place: which of them is wrong by itself; None if they are wrong together.
    """

    def __init__(self, sentence: str, place: int | None = None) -> None:
        super().__init__(sentence)
        self.place = place


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Correlations of pairs of factors; all other pairs have 0."""

    pairs: tuple[Pair, ...]
    #: One of `KINDS`.
    kind: str = "rank"

    def to_json(self) -> dict[str, object]:
        """Return it as `from_json` reads it."""
        return {"kind": self.kind, "pairs": [list(pair) for pair in self.pairs]}

    @staticmethod
    def from_json(data: Mapping[str, object]) -> "Dependence":
        """Return what `to_json` said."""
        pairs: Sequence[Pair] = data["pairs"]  # type: ignore[assignment]
        return Dependence(
            pairs=tuple((a, b, float(value)) for a, b, value in pairs), kind=str(data["kind"])
        )


@lru_cache(maxsize=64)
def copula(
    dependence: Dependence, names: tuple[str, ...], distributions: tuple[Distribution, ...]
) -> Array:
    """Return the correlation matrix of the normal variables that factors are made of.

    Cario and Nelson 1997, section 3: of ranks it is 2 sin(pi r / 6) (Pearson 1907), of values it is
    found by halving, since it grows with theirs.

    Args:
        dependence: what is wanted.
        names, distributions: of all factors, in their order.

    Returns:
        Shape (factors, factors), read only.

    Raises:
        DependenceError: a pair is unknown, listed twice or beyond what its distributions allow, or
            the correlations contradict each other.
    """
    if dependence.kind not in KINDS:
        raise DependenceError(
            f"correlations are of {' or '.join(KINDS)}, not of {dependence.kind!r}"
        )
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for place, (a, b, wanted) in enumerate(dependence.pairs):
        for name in (a, b):
            if name not in names:
                raise DependenceError(
                    f"{name} is not sampled, so it has no correlation: the study samples "
                    f"{', '.join(names)}",
                    place,
                )
        if a == b or frozenset((a, b)) in seen:
            what = ": a factor has no correlation with itself" if a == b else " are a pair twice"
            raise DependenceError(f"{a} and {b}{what}", place)
        seen.add(frozenset((a, b)))
        if not -1.0 < wanted < 1.0:
            raise DependenceError(
                f"a correlation lies between -1 and 1, and that of {a} and {b} is {wanted:g}: "
                "leave out a factor that is a function of another",
                place,
            )
        i, j = names.index(a), names.index(b)
        try:
            found = _of_normals(wanted, dependence.kind, distributions[i], distributions[j])
        except _BeyondReachError as reach:
            low, high = reach.args
            raise DependenceError(
                f"{a} and {b} cannot have a linear correlation of {wanted:g}: their distributions "
                f"allow {low:.3f} to {high:.3f}",
                place,
            ) from None
        matrix[i, j] = matrix[j, i] = found
    if np.linalg.eigvalsh(matrix)[0] < LEAST_EIGENVALUE:
        raise DependenceError(_contradiction(matrix, dependence.kind, names, distributions))
    matrix.setflags(write=False)
    return matrix


def conditional(correlation: Array, order: Sequence[int]) -> Array:
    """Return what makes correlated normals of independent ones, one factor after the other.

    The Cholesky factor of the correlations in that order (Rosenblatt 1952): the normal of the m-th
    factor is the sum of its entries m times the first m independent normals. By plain arithmetic,
    so that no library's blocking of sums shows in a design.
    """
    return _conditional(correlation.tobytes(), len(correlation), tuple(order))


def dependent(points: Array, correlation: Array, order: Sequence[int]) -> Array:
    """Return points whose coordinates, made in `order`, depend on each other (Rosenblatt 1952).

    Args:
        points: independent coordinates, shape (points, factors), between 0 and 1.
        correlation: from `copula`.
        order: of the factors; the first keeps its coordinate's bits up to rounding.

    Returns:
        The same shape. Points that agree in the first m factors of the order agree, bit for bit, in
        what is made of them.
    """
    lower, independent = conditional(correlation, order), ndtri(points)
    made = np.empty_like(points)
    for m, factor in enumerate(order):
        normal = lower[m, 0] * independent[:, order[0]]
        for earlier in range(1, m + 1):
            normal = normal + lower[m, earlier] * independent[:, order[earlier]]
        made[:, factor] = np.minimum(np.maximum(ndtr(normal), _LEAST), _MOST)
    return made


@lru_cache(maxsize=4096)
def _conditional(data: bytes, size: int, order: tuple[int, ...]) -> Array:
    correlation = np.frombuffer(data).reshape(size, size)
    wanted = [[float(correlation[i, j]) for j in order] for i in order]
    lower = [[0.0] * size for _ in order]
    for i in range(size):
        for j in range(i + 1):
            rest = wanted[i][j]
            for m in range(j):
                rest -= lower[i][m] * lower[j][m]
            lower[i][j] = rest**0.5 if i == j else rest / lower[j][j]
    return np.array(lower)


class _BeyondReachError(Exception):
    """Two distributions cannot have so large a linear correlation; from where to where they can."""


def _of_normals(wanted: float, kind: str, one: Distribution, other: Distribution) -> float:
    if wanted == 0.0:
        return 0.0
    if kind == "rank":
        return float(2.0 * np.sin(pi * wanted / 6.0))
    low, high = -0.9999, 0.9999
    least, most = (_linear(end, one, other) for end in (low, high))
    if not least <= wanted <= most:
        raise _BeyondReachError(least, most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = _linear(middle, one, other) < wanted
        low, high = (middle, high) if below else (low, middle)
    return 0.5 * (low + high)


def _linear(normal: float, one: Distribution, other: Distribution) -> float:
    """Return the correlation of values whose normals have the correlation `normal`."""
    # A rule for smooth functions takes the steps of discrete values amiss.
    node, weight = _nodes(isinstance(one, Discrete) or isinstance(other, Discrete))
    second = normal * node[:, None] + np.sqrt(1.0 - normal**2) * node
    x = _standardised(one.quantiles(_probability(node)), weight)
    of_node = other.quantiles(_probability(node))
    mean = weight @ of_node
    sd = np.sqrt(weight @ (of_node - mean) ** 2)
    y = (other.quantiles(_probability(second).ravel()).reshape(second.shape) - mean) / sd
    return float(np.einsum("i,j,i,ij->", weight, weight, x, y))


def _standardised(values: Array, weight: Array) -> Array:
    mean = weight @ values
    return np.asarray((values - mean) / np.sqrt(weight @ (values - mean) ** 2), dtype=np.float64)


def _probability(normal: Array) -> Array:
    found: Array = np.minimum(np.maximum(ndtr(normal), _LEAST), _MOST)
    return found


@lru_cache(maxsize=2)
def _nodes(steps: bool) -> tuple[Array, Array]:
    if steps:
        middles = (np.arange(_STRATA) + 0.5) / _STRATA
        return ndtri(middles), np.full(_STRATA, 1.0 / _STRATA)
    node, weight = np.polynomial.hermite_e.hermegauss(_NODES)
    return node, weight / weight.sum()


def _contradiction(
    matrix: Array, kind: str, names: Sequence[str], distributions: Sequence[Distribution]
) -> str:
    nearest = _nearest(matrix)
    shown = []
    for i, j in combinations(range(len(names)), 2):
        normal = float(nearest[i, j])
        value = (
            6.0 / pi * np.arcsin(normal / 2.0)
            if kind == "rank"
            else _linear(normal, distributions[i], distributions[j])
        )
        # Towards 0, which keeps what is possible possible.
        value = np.trunc(value * 10.0**_DECIMALS) / 10.0**_DECIMALS
        if value != 0.0:
            shown.append(f'["{names[i]}", "{names[j]}", {value:g}]')
    return (
        "these correlations contradict each other, or make a factor all but a function of others; "
        f"the nearest that can be sampled are [{', '.join(shown)}]"
    )


def _nearest(matrix: Array) -> Array:
    """Return the nearest correlation matrix with eigenvalues to spare (Higham 2002).

    By alternating projections with Dykstra's correction onto matrices with a unit diagonal and onto
    those whose eigenvalues are as large as rounding the result may cost.
    """
    spare = LEAST_EIGENVALUE + len(matrix) * 10.0**-_DECIMALS * 1.5
    found, correction = matrix.copy(), np.zeros_like(matrix)
    for _ in range(_PROJECTIONS):
        start = found - correction
        values, vectors = np.linalg.eigh(start)
        projected = (vectors * np.maximum(values, spare)) @ vectors.T
        correction = projected - start
        found = projected.copy()
        np.fill_diagonal(found, 1.0)
    # What the last step put on the diagonal may cost a little again.
    values = np.linalg.eigvalsh(found)
    short = max(0.0, (spare - values[0]) / max(1.0 - values[0], 1e-12))
    off: Array = found * (1.0 - short)
    np.fill_diagonal(off, 1.0)
    return off
