"""What cuffs do to the skin, from what they do in each step."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.assessment.skin import on_skin


def test_a_peak_is_what_is_borne_for_a_tenth_of_a_second_and_no_single_step() -> None:
    steps = np.zeros((100, 2))
    jumping, borne = steps.copy(), steps.copy()
    jumping[50] = 90e3
    borne[20:40] = (20e3, 30e3)
    loads = SimpleNamespace(
        peak_pressure=jumping + borne,
        mean_pressure=borne,
        peak_shear=jumping,
        mean_shear=borne,
        strain=1e-5 * borne,
    )
    found = on_skin(loads, step=0.01)  # type: ignore[arg-type]
    assert found["peak_pressure_upper_arm"] == pytest.approx(20.0)
    assert found["peak_pressure_forearm"] == pytest.approx(30.0)
    assert found["peak_shear_forearm"] == 0.0
    assert found["mean_pressure_upper_arm"] == pytest.approx(4.0)
    assert found["tissue_strain_forearm"] == pytest.approx(0.3)
