"""Sums of floating-point numbers that do not depend on the order of their terms.

Every double is an integer multiple of a power of two, so it can be cut into integer limbs on one
fixed grid. Limbs are summed as integers, which is exact, hence commutative and associative: any
order, any batching and any tree of merges leaves the same sum, which is rounded once, when it is
read. (The idea is Kulisch's long accumulator; the fixed grid follows Demmel and Nguyen 2015,
Parallel reproducible summation.)
"""

import numpy as np
from numpy.typing import NDArray

#: Bits per limb. In int64 a limb has room for 2**31 terms, counted with their weights.
LIMB_BITS = 32

#: How many terms one matrix product may sum: limb 2**32 * weight 2**4 * terms 2**16 < 2**53.
_TERMS_PER_PRODUCT = 2**16

#: Of so few weightings, copying the limbs takes longer than reading the weights.
_FEW_WEIGHTINGS = 16

#: As many numbers are cut at a time as a processor keeps near, of so many rows at least.
_NUMBERS_AT_ONCE, _ROWS_AT_ONCE = 2**15, 1024

#: Beyond, a power of two is no double.
_LARGEST_EXPONENT = 1000

Integers = NDArray[np.object_]
Doubles = NDArray[np.float64]
Columns = slice | NDArray[np.intp]


def split(values: NDArray[np.float64]) -> tuple[int, list[NDArray[np.float64]]]:
    """Cut finite numbers into limbs (Demmel and Nguyen 2015).

    Returns:
        `(low, limbs)` with `values == sum(limbs[j] * 2.0**(LIMB_BITS * (low + j)))` exactly; limbs
        are whole numbers of magnitude below 2**LIMB_BITS, each of the shape of `values`.

    Raises:
        ValueError: a value is not finite.
    """
    largest = float(np.max(np.abs(values), initial=0.0))
    if not np.isfinite(largest):
        raise ValueError("only finite numbers have a sum")
    high = int(np.frexp(largest)[1]) // LIMB_BITS
    limbs: list[NDArray[np.float64]] = []
    if high <= 0:
        # Products by powers of two from 1 on lose no digit, and need not be taken back.
        rest = _times_power(values, -LIMB_BITS * high)
        while not limbs or rest.any():
            limbs.append(np.trunc(rest))
            rest -= limbs[-1]
            rest *= 2.0**LIMB_BITS
        return high + 1 - len(limbs), limbs[::-1]
    rest, place = values, high
    while not limbs or rest.any():
        limb = _times_power(rest, -LIMB_BITS * place)
        np.trunc(limb, out=limb)
        rest = rest - _times_power(limb, LIMB_BITS * place)
        limbs.append(limb)
        place -= 1
    return place + 1, limbs[::-1]


def _times_power(values: NDArray[np.float64], exponent: int) -> NDArray[np.float64]:
    """Return values * 2**exponent; a product is as exact as `ldexp`, in a tenth of the time."""
    if abs(exponent) < _LARGEST_EXPONENT:
        return values * 2.0**exponent
    return np.ldexp(values, exponent)


class ExactSums:
    """Weighted sums of columns of numbers, several weightings at once.

    Raises:
        ValueError: from `merge`, if the shapes differ.
    """

    def __init__(self, weightings: int, columns: int) -> None:
        self.shape = (weightings, columns)
        #: Place of the first limb on the grid; never above 0, so that sums are whole multiples of
        #: 2**(LIMB_BITS * low) with a non-positive exponent.
        self.low = 0
        self.limbs: NDArray[np.int64] = np.zeros((1, *self.shape), dtype=np.int64)

    def add(
        self, columns: Columns, weights: NDArray[np.float64], terms: NDArray[np.float64]
    ) -> None:
        """Add `weights @ terms[i]`, for every i, to some of the columns.

        Args:
            columns: which, each once.
            weights: whole numbers from 0 to 15, shape (weightings, rows).
            terms: finite, shape (terms per row, rows, columns).

        Raises:
            ValueError: a term is not finite.
        """
        per_row, rows, width = terms.shape
        near = max(_NUMBERS_AT_ONCE // max(per_row * width, 1), _ROWS_AT_ONCE)
        size = max(min(_TERMS_PER_PRODUCT // max(per_row, 1), near), 1)
        for start in range(0, rows, size):
            batch = slice(start, start + size)
            low, limbs = split(terms[:, batch])
            # In floating point for the speed of BLAS: every partial sum is a whole number below
            # 2**53, so the product is exact in whatever order it is taken.
            whole = [limb[0] if per_row == 1 else limb.sum(axis=0) for limb in limbs]
            if len(weights) <= _FEW_WEIGHTINGS:
                product = np.stack([weights[:, batch] @ limb for limb in whole])
            else:
                # All limbs at once, since reading the weights takes longer than multiplying them.
                found = weights[:, batch] @ np.concatenate(whole, axis=1)
                product = np.moveaxis(found.reshape(len(weights), len(whole), width), 1, 0)
            self._include(low, product.astype(np.int64), columns)

    def merge(self, other: "ExactSums") -> None:
        """Add the sums of `other`."""
        if self.shape != other.shape:
            raise ValueError(f"cannot merge sums of shape {other.shape} into {self.shape}")
        self._include(other.low, other.limbs, slice(None))

    @property
    def shift(self) -> int:
        """What the whole numbers of `integers` count: 2**-shift."""
        return -LIMB_BITS * self.low

    def integers(self, columns: slice, stop: int | None = None) -> Integers:
        """Return the exact sums of `columns` as whole numbers of 2**-shift.

        Python integers, shape (weightings, columns of the slice), of the first `stop` weightings.
        """
        limbs = self.limbs[:, :stop, columns]
        total: Integers = np.zeros(limbs.shape[1:], dtype=object)
        for limb in limbs[::-1]:
            total = total * 2**LIMB_BITS + limb.astype(object)
        return total

    def doubles(self, columns: slice, start: int, stop: int) -> tuple[Doubles, Doubles]:
        """Return the sums of some weightings to 30 digits: `(high, low)`, the sum is high + low.

        In a fixed order from limbs that are whole numbers (two-sum of Knuth 1969), hence as
        independent of the order of terms as `integers`, and much faster. Shape (weightings,
        columns of the slice).
        """
        limbs = self.limbs[:, start:stop, columns]
        high: Doubles = np.zeros(limbs.shape[1:])
        low: Doubles = np.zeros(limbs.shape[1:])
        for place in range(len(limbs) - 1, -1, -1):
            for half, bits in ((limbs[place] >> 32, 32), (limbs[place] & 0xFFFFFFFF, 0)):
                term = np.ldexp(half.astype(np.float64), LIMB_BITS * (self.low + place) + bits)
                high, off = _two_sum(high, term)
                low = low + off
        return _two_sum(high, low)

    def _include(self, low: int, limbs: NDArray[np.int64], columns: Columns) -> None:
        below = max(self.low - low, 0)
        above = max(low + len(limbs) - (self.low + len(self.limbs)), 0)
        if below or above:
            # As `numpy.pad` does, which takes ten times as long.
            more = np.zeros((below + len(self.limbs) + above, *self.shape), dtype=np.int64)
            more[below : below + len(self.limbs)] = self.limbs
            self.limbs, self.low = more, self.low - below
        start = low - self.low
        self.limbs[start : start + len(limbs), :, columns] += limbs


def square(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `(high, low)` with high + low the exact square (Dekker 1971), elementwise.

    Exact for magnitudes from 1e-140 to 1e150.
    """
    scaled = values * (2.0**27 + 1.0)
    head = scaled - (scaled - values)
    tail = values - head
    high = values * values
    low = ((head * head - high) + 2.0 * head * tail) + tail * tail
    return high, low


def divide(numerators: Integers, denominators: Integers, shift: int = 0) -> NDArray[np.float64]:
    """Return numerators / (denominators * 2**shift), rounded once; nan where a denominator is 0.

    What a long accumulator (Demmel and Nguyen 2015) is read by.
    """
    scaled = denominators << shift if shift else denominators
    return np.asarray(_divide(numerators, scaled), dtype=np.float64)


_divide = np.frompyfunc(lambda n, d: n / d if d else np.nan, 2, 1)


def variance_of_doubles(
    total: tuple[Doubles, Doubles],
    squares: tuple[Doubles, Doubles],
    n: NDArray[np.int64],
    ddof: int,
) -> Doubles:
    """Return (n squares - total^2) / (n (n - ddof)) from sums of `ExactSums.doubles` (Dekker 1971).

    0 where what is left is below what 30 digits can tell; nan where a denominator is 0.
    """
    count = n.astype(np.float64)
    square_high, square_low = square(total[0])
    square_low = square_low + 2.0 * total[0] * total[1]
    times_high = count * squares[0]
    times_low = _product_error(count, squares[0], times_high) + count * squares[1]
    high, off = _two_sum(times_high, -square_high)
    left = high + (off + (times_low - square_low))
    left = np.where(left > 1e-26 * times_high, left, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(n > ddof, left / (count * (count - ddof)), np.nan)


def _two_sum(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """Return a + b rounded, and by how much that is short."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


def _product_error(a: Doubles, b: Doubles, product: Doubles) -> Doubles:
    """Return a b - product, which is a b rounded (Dekker 1971)."""
    parts = []
    for one in (a, b):
        scaled = one * (2.0**27 + 1.0)
        head = scaled - (scaled - one)
        parts.append((head, one - head))
    (a_head, a_tail), (b_head, b_tail) = parts
    error: Doubles = a_head * b_head - product
    return ((error + a_head * b_tail) + a_tail * b_head) + a_tail * b_tail
