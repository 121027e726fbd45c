"""What makes a residual more than noise."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.findings import Floor, Outcome, Structure, Trace
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.judgement.outcome import _large, _something_is_left


@pytest.mark.parametrize(("size", "left"), [(0.03, False), (0.08, True)])
def test_an_oscillation_counts_only_next_to_the_floor(size: float, left: bool) -> None:
    outcome = SimpleNamespace(
        left={},
        structures={},
        events=(),
        loads=(),
        floors={0: Floor(value=0.1, source="above the band")},
        oscillations={0: [Peak(low_hz=90.0, high_hz=110.0, rms=size)]},
    )
    assert _something_is_left(cast(Outcome, outcome)) is left
    assert _something_is_left(cast(Outcome, SimpleNamespace(**{**vars(outcome), "floors": {}})))


@pytest.mark.parametrize(("smoothing", "kept"), [(0.02, True), (0.2, False)])
def test_what_goes_with_a_signal_counts_if_smoothing_does_not_make_it(
    smoothing: float, kept: bool
) -> None:
    """A structure of a thousandth of the effort: less than backlash leaves on a good robot."""
    count = 100
    rows = SimpleNamespace(
        samples={0: np.arange(count)},
        parts={0: slice(0, count)},
        weight=np.full(count, 0.5),
        effort_power=lambda joint: count * (0.5 * 50.0) ** 2,
        smoothing_power=lambda joint: count * (0.5 * smoothing) ** 2,
    )
    found = {0: [Structure(signal="effort", rms=0.05, p_value=1e-9)]}
    floors = {0: Floor(value=0.1, source="repeats")}
    trace = cast(Trace, SimpleNamespace(rows=rows))
    assert bool(_large(trace, found, floors)[0]) is kept
