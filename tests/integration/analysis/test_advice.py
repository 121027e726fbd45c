"""Whether the advice of how many rows to add comes true."""

from dataclasses import replace
from statistics import median

import pytest

from analysis.sensitivity.judgement.stopping import advise
from analysis.sensitivity.service import analyse
from tests.testbed.studies import results_of, study_plan


def test_the_advice_holds_when_it_is_followed() -> None:
    """Of Latin hypercubes, whose errors fall with the square root of the rows; by their median.

    A half width is itself estimated from eight replicates: one study's may be half as wide again.
    """
    widths = []
    for seed in range(1, 10):
        plan = study_plan("saltelli", rows=200, sampling="latin_hypercube", seed=seed)
        first = advise(analyse(plan, results_of(plan)), "y", target=0.06)
        assert first is not None and first.more_rows > 0
        longer = replace(plan, rows=200 + first.more_rows)
        then = advise(analyse(longer, results_of(longer)), "y", target=0.06)
        assert then is not None
        widths.append(then.half_width)
    assert median(widths) == pytest.approx(0.06, rel=0.25)
