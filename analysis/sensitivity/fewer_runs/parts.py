"""What a fitted function says of each factor: its parts, and how much they vary."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Which factors are normal, shape (factors,): what rises evenly with one rises without bound
#: towards the ends of its probabilities, where no run is, so it is taken in standard deviations
#: (the Wiener-Askey scheme of Xiu and Karniadakis 2002).
Normal = NDArray[np.bool_]

#: Cells along each factor at whose middles `Surrogate.pairs` says what two do together.
CELLS = 16

#: Their middles.
MIDDLES = (np.arange(CELLS) + 0.5) / CELLS


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of a function of the unit cube (Hoeffding 1948; Sobol 1993), at n points."""

    #: The function itself, shape (n,).
    value: Array
    #: The function minus its mean, shape (n,).
    centred: Array
    #: What each factor does alone: its conditional mean minus the mean, shape (n, factors).
    first: Array
    #: What each factor does alone or in company: the function minus its mean over that factor,
    #: shape (n, factors).
    total: Array
    #: Mean squares of the last three over the cube.
    variance: float
    #: Shape (factors,).
    first_squares: Array
    total_squares: Array


class Surrogate(Protocol):
    """A kind of function that can be fitted to some runs (Da Veiga and Gamboa 2013)."""

    def without(self, y: Array, away: NDArray[np.bool_]) -> Parts:
        """Fit to the values `y` (n,) of the runs that are not `away`; return its parts at those.

        Nothing of `y` is looked at where runs are away.
        """

    def pairs(self, y: Array) -> Array:
        """Fit to all runs; return what every two factors do beyond what each does alone.

        Shape (pairs, CELLS, CELLS), pairs in the order of `itertools.combinations`: the part of
        the second order (Sobol 1993) where the two are at `MIDDLES`.
        """
