"""What filters and shifts of a signal do."""

import numpy as np
import pytest

from analysis.closeloop.session.signals import lagged, shifted, slope


def test_a_delay_and_its_opposite_cancel() -> None:
    t = np.arange(1000) / 200.0
    signal = np.sin(3 * t)[:, None]
    back = shifted(shifted(signal, 0.031, 200.0), -0.031, 200.0)
    assert back[20:-20] == pytest.approx(signal[20:-20], abs=2e-4)


@pytest.mark.parametrize("time_constant", [0.05, 0.004, 0.0007])
def test_a_lag_is_behind_by_its_time_constant_however_coarse_the_samples(
    time_constant: float,
) -> None:
    ramp = np.arange(2000)[:, None] / 200.0
    behind = ramp - lagged(ramp, time_constant, 200.0)
    assert behind[0, 0] == 0.0
    assert behind[-1, 0] == pytest.approx(time_constant, rel=1e-6)


def test_a_slope_is_right_up_to_a_tenth_of_the_sampling_rate() -> None:
    t = np.arange(500) / 100.0
    w = 2 * np.pi * 10.0
    found = slope(np.sin(w * t)[:, None], 100.0)[20:-20, 0]
    assert found == pytest.approx(w * np.cos(w * t)[20:-20], abs=0.002 * w)
