"""What filters and shifts of a signal do."""

import numpy as np
import pytest

from analysis.closeloop.session.signals import lagged, shifted


def test_a_delay_and_its_opposite_cancel() -> None:
    t = np.arange(1000) / 200.0
    signal = np.sin(3 * t)[:, None]
    back = shifted(shifted(signal, 0.031, 200.0), -0.031, 200.0)
    assert back[20:-20] == pytest.approx(signal[20:-20], abs=2e-4)


def test_a_lag_is_behind_by_its_time_constant() -> None:
    ramp = np.arange(2000)[:, None] / 1000.0
    assert lagged(ramp, 0.05, 1000.0)[-1] == pytest.approx(ramp[-1] - 0.05, abs=1e-3)
