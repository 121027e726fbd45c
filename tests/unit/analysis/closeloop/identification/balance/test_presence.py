"""What may be nothing is called so, and what is sure together is there."""

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.presence import _sure, surely_there
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.balance.uncertainty import Fits
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.coupled import moving


def means(sample: np.ndarray) -> Fits:
    """Return the fits of a sample's mean, (trials, k): to all of it, and without each trial."""
    without = (sample.sum(axis=0) - sample) / (len(sample) - 1)
    return Fits(
        coefficients=np.vstack([sample.mean(axis=0), without]),
        thetas={},
        steps=np.empty(0),
        sizes=(len(sample),),
        white=(),
    )


@pytest.mark.parametrize("size", [1, 2, 3])
def test_what_is_nothing_is_sure_in_a_tenth_of_all_cases(size: int) -> None:
    rng = np.random.default_rng(7)
    mixed = rng.standard_normal((size, size))
    seen = [means(rng.standard_normal((6, size)) @ mixed) for _ in range(2000)]
    sure = [_sure(fits, fits.coefficients[0], fits.coefficients) > 1.0 for fits in seen]
    assert np.mean(sure) == pytest.approx(0.1, abs=4.0 * np.sqrt(0.09 / 2000))


def test_two_coefficients_may_be_sure_together_where_neither_is_alone() -> None:
    """A drift's rate and beginning, as trials see them: their sum is known, not their parts."""
    rng = np.random.default_rng(1)
    share = rng.normal(0.0, 5.0, 6)
    fits = means(np.column_stack([1.0 + share, 1.0 - share + rng.normal(0.0, 0.1, 6)]))
    for one in (0, 1):
        assert _sure(fits, fits.coefficients[0, [one]], fits.coefficients[:, [one]]) < 1.0
    assert _sure(fits, fits.coefficients[0], fits.coefficients) > 5.0
    few = means(np.ones((2, 2)))
    assert _sure(few, few.coefficients[0], few.coefficients) == 0.0


def test_what_ends_at_its_bound_in_every_fit_is_sure() -> None:
    """Of friction that a vendor's file declares and no joint has, two joints kept all."""
    gone = means(np.tile([-1.0, 0.3], (4, 1)) + np.outer([1.0, -1.0, 1.0, -1.0], [0.0, 0.5]))
    for ones, sure in (([0], np.inf), ([0, 1], np.inf)):
        assert _sure(gone, gone.coefficients[0, ones], gone.coefficients[:, ones]) == sure
    assert _sure(gone, gone.coefficients[0, [1]], gone.coefficients[:, [1]]) < 1.0
    none = means(np.zeros((4, 1)))
    assert _sure(none, none.coefficients[0], none.coefficients) == 0.0


@pytest.mark.parametrize(("apart", "there"), [(0.0, True), (0.02, False)])
def test_a_robot_s_wrong_zero_has_one_size_at_every_place(apart: float, there: bool) -> None:
    """Other effects are laws, whose size may differ; two arms had a zero that was none."""
    here = Candidate(effect=BY_NAME["position_offset"], joint=1)
    term = Term(effect=here.effect, joint=1, columns={}, kept=(0,), candidate=here)
    trials, places = 0.01 + 1e-4 * np.arange(-3, 4), 0.01 + apart * np.linspace(-1.0, 1.0, 8)
    every = np.concatenate([[0.01], trials, places, np.full(8, 0.01)])[:, None]
    nothing = np.empty((0, 0))
    fits = Fits(
        coefficients=every,
        thetas={},
        steps=np.empty(0),
        sizes=(len(trials), len(places), 8),
        white=(nothing, nothing, nothing),
    )
    sure = surely_there(fits, Model(moving(), terms=(term,)), every[0], here)
    assert (sure > 1.0) is there
