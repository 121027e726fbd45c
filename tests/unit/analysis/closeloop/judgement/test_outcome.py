"""What makes a residual more than noise."""

from types import SimpleNamespace
from typing import cast

import pytest

from analysis.closeloop.identification.findings import Floor, Outcome
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.judgement.outcome import _something_is_left


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
