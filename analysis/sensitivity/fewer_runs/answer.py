"""What few runs say of an output's indices, and whether that may be believed.

Two kinds of surrogates are fitted, and the one that explains more of the runs held out is taken
(Marrel et al. 2009); held-out runs correct it and give its intervals
(`analysis.sensitivity.fewer_runs.corrected`). It is no answer where they explain too little.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators.tails import HEAVY_KURTOSIS
from analysis.sensitivity.fewer_runs.corners import in_corners
from analysis.sensitivity.fewer_runs.corrected import Corrected, HeldOut, corrected, held_out
from analysis.sensitivity.fewer_runs.expansion import Expansions
from analysis.sensitivity.fewer_runs.gaussian_process import Processes, find_scales
from analysis.sensitivity.fewer_runs.limits import (
    FEWEST_RUNS,
    LEAST_EXPLAINED,
    LEAST_RUNS,
    MOST_RUNS,
    ROUNDING,
)
from analysis.sensitivity.fewer_runs.parts import Surrogate

Array = NDArray[np.float64]

#: Share of failed runs from which they may matter.
_FAILED = 0.02

#: Share of the variance beyond the outermost runs from which shares of it are not believed. Set on
#: seeds from 60 000 on: (1 - u)^-0.3 has 0.05 and more, borehole as the steepest of the smooth
#: functions of `tests.testbed.functions` 0.04 and less.
_BEYOND = 0.045

#: The same between the runs: half of what is wanted of an interval. Set on seeds from 60 000 on,
#: where smooth functions have 0.001 and less, and a resonance 0.011.
_BETWEEN = 0.01

#: What one run in a corner of two factors may stand for. Set on seeds from 60 000 on, where
#: Ishigami's function, the steepest of the smooth ones, has 0.0014 and less, and studies of
#: (a + b)^-0.6, 1 / (0.02 + a + b) and 1 / (1.03 - a b) that were sure of indices off by more than
#: 0.05 had 0.003 and more. The truth is ten times that: a surrogate is flat where no run is.
_IN_CORNERS = 0.002

#: A polynomial chaos that explains so much is taken as it is: a process takes longer.
_ENOUGH = 0.9995


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What some runs say of the indices of one output."""

    #: How many there were, and how many of these failed.
    runs: int
    failed: int
    #: "gaussian process" or "polynomial chaos".
    surrogate: str
    found: Corrected
    #: Why it is not to be believed; empty if it is.
    doubt: str

    @property
    def half_width(self) -> float:
        """Of the widest interval of any first- or total-order index."""
        both = (self.found.first_order, self.found.total_order)
        return max(float((one.high - one.low).max()) for one in both) / 2.0


def answer(
    x: Array, y: Array, seed: int, level: float = 0.9, *, normal: Sequence[bool] | None = None
) -> Answer | None:
    """Return the indices of an output from few runs (Da Veiga and Gamboa 2013).

    Args:
        x: points of the unit cube that fill it evenly, shape (n, factors).
        y: what was found there, shape (n,); nan where a run failed.
        seed: of the study; decides which runs are held out together.
        level: of the intervals.
        normal: whether each factor is normal; None: none is.

    Returns:
        None while there are too few runs, or where nothing varies.

    Raises:
        ValueError: there are too many runs.
    """
    if len(y) > MOST_RUNS:
        raise ValueError(f"surrogates are fitted to {MOST_RUNS} runs at most, not {len(y)}")
    ok = np.isfinite(y)
    runs, failed = len(y), int((~ok).sum())
    x, y = x[ok], y[ok]
    if len(y) < LEAST_RUNS or np.ptp(y) <= ROUNDING * np.abs(y).max():
        return None
    # Divided once more beforehand, because squares of tiny numbers are 0.
    y = (y - y.mean()) / np.ptp(y)
    y = (y - y.mean()) / y.std()
    bells = np.zeros(x.shape[1], dtype=np.bool_) if normal is None else np.array(normal)
    kinds: dict[str, Surrogate] = {"polynomial chaos": Expansions(x, bells)}
    held = {kind: held_out(one, y, seed) for kind, one in kinds.items()}
    if held["polynomial chaos"].explained(y) < _ENOUGH:
        kinds["gaussian process"] = Processes(x, find_scales(x, y, bells), bells)
        held["gaussian process"] = held_out(kinds["gaussian process"], y, seed)
    surrogate = max(kinds, key=lambda kind: held[kind].explained(y))
    found = corrected(y, held[surrogate], level)
    doubt = _doubt(x, y, found, held[surrogate], runs, failed)
    if not doubt and in_corners(kinds[surrogate].pairs(y), len(y)) > _IN_CORNERS:
        doubt = (
            "it rises so steeply where two factors near their ends together that much of its "
            "variance may lie there, where no run is"
        )
    return Answer(
        runs=runs,
        failed=failed,
        surrogate=surrogate,
        found=found,
        doubt=doubt,
    )


def _doubt(x: Array, y: Array, found: Corrected, held: HeldOut, runs: int, failed: int) -> str:
    """Return why an answer is not to be believed; empty if it is."""
    if runs < FEWEST_RUNS:
        return f"of fewer than {FEWEST_RUNS} runs no answer is believed"
    if failed > _FAILED * runs:
        return f"{failed} of {runs} runs failed, and what they would have said may matter"
    kurtosis = float((y**4).mean())
    if kurtosis > HEAVY_KURTOSIS:
        return (
            f"few runs make up its variance (its kurtosis is {kurtosis:.1f}), so those that were "
            "not made may change it"
        )
    if (beyond := held.beyond(x)) > _BEYOND:
        return (
            "it grows so steeply towards the end of a factor that about "
            f"{beyond:.0%} of its variance may lie beyond the outermost runs"
        )
    if (between := held.between(x)) > _BETWEEN:
        return (
            "it rises so steeply inside the range of a factor that about "
            f"{between:.1%} of its variance may lie between the runs"
        )
    if found.explained < LEAST_EXPLAINED:
        return (
            f"no surrogate predicts runs that were held out: {max(found.explained, 0.0):.0%} of "
            "the variance at best"
        )
    return ""
