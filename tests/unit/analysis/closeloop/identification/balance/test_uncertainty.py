"""An interval is made of the fits with a part left out."""

import numpy as np
import pytest
from scipy import stats

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.uncertainty import (
    Fits,
    half_width,
    slopes_of,
    variance,
)
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, TRUTH, added, rich_elbow


def test_the_interval_of_a_mean_is_students() -> None:
    sample = np.random.default_rng(3).normal(2.0, 0.5, 7)
    left_out = np.array([np.delete(sample, i).mean() for i in range(7)])
    _, high = stats.t.interval(0.9, 6, sample.mean(), stats.sem(sample))
    half = half_width(variance(float(sample.mean()), left_out), 6.0)
    assert half == pytest.approx(high - sample.mean())


def test_places_count_only_beyond_what_noise_makes_of_them() -> None:
    alone = half_width(4.0, 7.0)
    assert alone == pytest.approx(2.0 * stats.t.ppf(0.95, 7))
    assert half_width(4.0, 7.0, [(-1.0, 15.0), (-0.1, 4.0)]) == alone
    freedom = 13.0**2 / (4.0**2 / 7 + 9.0**2 / 4)
    wide = half_width(4.0, 7.0, [(2.0, 15.0), (9.0, 4.0)])
    assert wide == pytest.approx(np.sqrt(13.0) * stats.t.ppf(0.95, freedom))


def test_an_interval_holds_the_whole_fit_and_ends_at_a_physical_bound() -> None:
    one = np.eye(1)
    fits = Fits(
        coefficients=np.empty((0, 1)), thetas={}, steps=np.ones(1), sizes=(3,), white=(one,)
    )
    low, high = fits.interval(np.array([0.3, 0.3, 0.2, 0.4, 0.3]), 0.05, lowest=0.0)
    assert low == 0.0
    assert high >= 0.3


def test_of_a_step_that_ends_at_its_bound_an_interval_goes_as_far_the_other_way() -> None:
    one = np.eye(1)
    fits = Fits(
        coefficients=np.empty((0, 1)), thetas={}, steps=np.ones(1), sizes=(3,), white=(one,)
    )
    assert fits.interval(np.zeros(5), 0.3, lowest=0.0) == pytest.approx((0.0, 0.6))
    # What has no bound is where all fits say that it is.
    assert fits.interval(np.zeros(5), 0.3) == pytest.approx((0.0, 0.3))


@pytest.mark.parametrize("seconds", [0.0003, 0.03])
def test_a_time_that_is_shorter_than_its_step_has_a_slope(seconds: float) -> None:
    """Less than no time made a slope without end, and a stranger's session had no report."""
    elbow, (theta, size) = rich_elbow(), TRUTH["stretch_reflex"]
    theta = {**theta, "activation_time": seconds}
    columns = BY_NAME["stretch_reflex"].columns(unfitted(elbow, ELBOW), theta)
    model = Model(elbow, terms=(added("stretch_reflex", columns, theta),))
    slopes = {name: slope for _, name, slope in slopes_of(model, np.array(size))}
    assert "activation_time" in slopes
    assert all(np.isfinite(slope[:, ELBOW]).all() for slope in slopes.values())
