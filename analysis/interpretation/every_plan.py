"""The half width after every set of steps that can be measured: none is passed over.

What is measured conditions K one factor at a time (Rasmussen and Williams 2006, Gaussian processes
for machine learning, equation A.6), so that sets which begin alike share what they begin with: the
8192 sets of 13 steps take half a second.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.posterior import TARGETS, places
from analysis.interpretation.inference.view import View


@dataclass(frozen=True, kw_only=True)
class _Rows:
    """The bank's rows and, last, the recording: n, of whom m factors may still be measured.

    The last column of all is K.
    """

    #: What was measured so far says of them, shape (n, m + 1).
    mean: np.ndarray
    #: Shape (n, m + 1, m + 1).
    covariance: np.ndarray
    #: What would be read of the factors without an error, shape (n, m).
    errors: np.ndarray
    #: What such a reading is off by, over its standard deviation, shape (n, m).
    noise: np.ndarray

    def measured(self, sd: float) -> "_Rows":
        """Return them with the first of the factors measured to a standard deviation."""
        across = self.covariance[:, 1:, 0]
        gain = across / (self.covariance[:, :1, 0] + sd**2)
        surprise = self.errors[:, :1] + sd * self.noise[:, :1] - self.mean[:, :1]
        return _Rows(
            mean=self.mean[:, 1:] + gain * surprise,
            covariance=self.covariance[:, 1:, 1:] - gain[:, :, None] * across[:, None, :],
            errors=self.errors[:, 1:],
            noise=self.noise[:, 1:],
        )

    def passed_over(self) -> "_Rows":
        """Return them with the first of the factors never measured."""
        return _Rows(
            mean=self.mean[:, 1:],
            covariance=self.covariance[:, 1:, 1:],
            errors=self.errors[:, 1:],
            noise=self.noise[:, 1:],
        )


def every_plan(
    interpreter: Interpreter, view: View, known: tuple[Known, ...], to: dict[str, float]
) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield each set of factors and the half width of K's 90 % interval after it, Nm/rad.

    The first set is empty. A factor of `known` that is measured again counts as that alone.

    Args:
        interpreter: of a bank.
        view: what the recording says.
        known: what was measured on the patient before.
        to: the standard deviation to which each factor would be measured.

    Raises:
        InterpretationError: a known value is impossible in this population.
    """
    own_columns, own_sds = interpreter.measured(known)
    columns, sds = interpreter.measurable(to)
    before = dict(zip(own_columns.tolist(), own_sds.tolist(), strict=True))
    after = dict(zip(columns.tolist(), sds.tolist(), strict=True))
    names = dict(zip(columns.tolist(), to, strict=True))
    # First what is known and stays so, which all sets begin with.
    order = sorted({*before, *after}, key=lambda column: column in after)
    errors = view.rows.of_targets[:, 0]
    ends = places(len(view.rows.to_its_sides(errors)), np.array([0.05, 0.95]))
    rows = _rows(view, np.array(order, dtype=int))

    def width(found: _Rows) -> float:
        spread = np.sqrt(np.maximum(found.covariance[:, 0, 0], 1e-10))
        scores = view.rows.to_its_sides((errors - found.mean[:-1, 0]) / spread[:-1])
        low, high = ends
        # Sorted as far as its ends ask.
        scores.partition(ends)
        return float(spread[-1] * (scores[high] - scores[low]) / 2.0)

    def from_here(
        place: int, done: tuple[str, ...], found: _Rows
    ) -> Iterator[tuple[tuple[str, ...], float]]:
        if place == len(order):
            yield done, width(found)
            return
        column = order[place]
        without = found.measured(before[column]) if column in before else found.passed_over()
        yield from from_here(place + 1, done, without)
        if column in after:
            yield from from_here(place + 1, (*done, names[column]), found.measured(after[column]))

    yield from from_here(0, (), rows)


def _rows(view: View, columns: np.ndarray) -> _Rows:
    """Return the bank's rows and the recording, with nothing measured of `columns`."""
    own_rows, count = view.rows, len(columns)
    _, covariances = own_rows.as_measured(columns, np.zeros(count))
    # K is the first of the targets; here it is the last of all.
    kept = np.concatenate([len(TARGETS) + np.arange(count), [0]])
    chosen = np.concatenate([columns, [0]])
    own = view.covariance[np.ix_(chosen, chosen)]
    # What is read of this patient moves K, and nobody knows whither.
    nobody = np.zeros((1, count))
    return _Rows(
        mean=np.zeros((len(covariances) + 1, count + 1)),
        covariance=np.concatenate([covariances[:, kept][:, :, kept], own[None]]),
        errors=np.vstack([own_rows.errors[:, columns], nobody]),
        noise=np.vstack([own_rows.noise[:, columns], nobody]),
    )
