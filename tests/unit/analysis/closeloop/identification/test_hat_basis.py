"""Splines on a signal say what the signal says, and nothing of its last digits."""

import numpy as np
import pytest

from analysis.closeloop.identification.hat_basis import hat_basis


def test_a_joint_that_is_held_in_three_postures_has_two_hats_whatever_its_last_digits() -> None:
    postures = np.repeat([-1.2, -0.55, 0.1], 50)
    dust = 1e-15 * np.random.default_rng(2).standard_normal(len(postures))
    plain = hat_basis(postures, 5)
    assert plain.shape == (150, 2)
    np.testing.assert_allclose(hat_basis(postures + dust, 5), plain, atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e-4])
def test_hats_between_their_knots_add_up_to_any_broken_line(scale: float) -> None:
    signal = scale * np.linspace(-1.0, 2.0, 101)
    hats = hat_basis(signal, 4)
    assert hats.shape == (101, 3)
    table = np.column_stack([np.ones(101), hats])
    bent = np.abs(signal)
    fitted = table @ np.linalg.lstsq(table, bent)[0]
    # Zero is a knot: a third of the samples is below it.
    assert np.abs(fitted - bent).max() < 0.02 * scale
