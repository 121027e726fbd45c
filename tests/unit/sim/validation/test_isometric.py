"""The isometric test of the elbow."""

import pytest

from sim.validation.isometric import run_isometric_test


def test_isometric_peaks_are_those_of_the_papers_figure_3() -> None:
    test = run_isometric_test()
    assert test.flexion_peak[0] == pytest.approx(80.0, rel=0.05)
    assert test.extension_peak[0] == pytest.approx(-50.0, rel=0.05)
    assert 60.0 <= test.flexion_peak[1] <= 90.0
