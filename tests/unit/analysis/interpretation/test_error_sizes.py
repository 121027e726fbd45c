"""Errors that grow with what is predicted make wider intervals there."""

import numpy as np
import pytest
from sklearn.linear_model import GammaRegressor

from analysis.interpretation.inference.error_sizes import (
    LEAST,
    PENALTY,
    ErrorSizes,
    sizes_of_rows,
)
from analysis.interpretation.inference.local_errors import LocalErrors
from analysis.interpretation.inference.posterior import TARGETS, Posterior

COUNT, INPUTS = 400, 26


def rows(seed: int, count: int = COUNT) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places, predictions and errors: of K, a tenth of it and hardly less near none."""
    rng = np.random.default_rng(seed)
    places = rng.standard_normal((count, INPUTS))
    predicted = np.tile(4.0 * places[:, :1] + 3.0, (1, len(TARGETS)))
    sizes = 0.05 + 0.1 * np.abs(predicted[:, :1])
    return places, predicted, sizes * rng.standard_normal((count, len(TARGETS) + 1))


def test_the_regression_is_scikit_learns() -> None:
    _, predicted, errors = rows(1)
    predicted = predicted[:, :1]
    found = ErrorSizes.fit(predicted, errors)
    unit = np.sqrt((predicted**2).mean())
    both = np.hstack([predicted / unit, np.log1p(np.abs(predicted) / unit)])
    inputs = (both - both.mean(axis=0)) / both.std(axis=0)
    for column, squared in enumerate((errors**2).T):
        model = GammaRegressor(alpha=PENALTY, max_iter=1000, tol=1e-8)
        model.fit(inputs, np.maximum(squared, LEAST * squared.mean()))
        expected = [model.intercept_, *model.coef_]
        assert found.weights[:, column] == pytest.approx(expected, abs=1e-4)


def test_errors_are_as_large_as_where_they_were_seen_and_no_larger_beyond() -> None:
    _, predicted, errors = rows(2)
    found = ErrorSizes.fit(predicted, errors)
    at = np.array([0.5, 5.0, 11.0])[:, None] * np.ones(len(TARGETS))
    assert found.at(at)[:, 0] == pytest.approx([0.1, 0.55, 1.15], rel=0.35)
    far = found.at(np.full((1, len(TARGETS)), 1e6))
    assert far == pytest.approx(found.at(predicted.max(axis=0)[None]))


def test_what_is_never_wrong_has_a_size_all_the_same() -> None:
    _, predicted, errors = rows(3)
    errors[:, 1] = 0.0
    assert (sizes_of_rows(predicted, errors) > 0.0).all()


def test_a_rows_size_is_what_the_others_tell() -> None:
    _, predicted, errors = rows(4)
    changed = errors.copy()
    changed[7] *= 100.0
    same = sizes_of_rows(predicted, errors)[7] / sizes_of_rows(predicted, changed)[7]
    assert same == pytest.approx(1.0)


@pytest.mark.parametrize(("low", "high"), [(-99.0, 1.0), (1.0, 3.0), (3.0, 6.0), (6.0, 99.0)])
def test_intervals_hold_as_often_for_stiff_as_for_compliant_wearers(
    low: float, high: float
) -> None:
    places, predicted, errors = rows(5)
    local = LocalErrors.fit(places, predicted, errors)
    nothing = np.empty(0, dtype=int), np.empty(0)
    fresh, told, off = rows(6, 1000)
    chosen = (told[:, 0] >= low) & (told[:, 0] < high)
    spreads = np.sqrt(local.around(fresh[chosen], told[chosen])[:, 0, 0])
    belief = Posterior(
        centre=np.zeros(len(TARGETS)),
        spread=np.ones(len(TARGETS)),
        scores=local.rows.scores(*nothing),
    )
    ends = belief.quantiles(np.array([0.05, 0.95]))[:, 0]
    score = off[chosen, 0] / spreads
    assert np.mean((score > ends[0]) & (score < ends[1])) == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.5), (1.5, 9.0)])
def test_intervals_hold_as_often_at_the_ends_of_lengths_as_amid_them(
    low: float, high: float
) -> None:
    def arms(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        places, predicted, errors = rows(seed, count)
        length = np.random.default_rng(seed + 100).standard_normal((count, 1))
        return places, np.hstack([predicted, length]), errors * (0.4 + np.abs(length))

    local = LocalErrors.fit(*arms(7, 1000))
    fresh, told, off = arms(8, 2000)
    chosen = (np.abs(told[:, -1]) >= low) & (np.abs(told[:, -1]) < high)
    score = off[chosen, 0] / np.sqrt(local.around(fresh[chosen], told[chosen])[:, 0, 0])
    scores = local.rows.scores(np.empty(0, dtype=int), np.empty(0))[:, 0]
    low_end, high_end = np.quantile(scores, [0.05, 0.95])
    assert np.mean((score > low_end) & (score < high_end)) == pytest.approx(0.9, abs=0.05)


@pytest.mark.filterwarnings("error")
def test_a_few_large_errors_far_out_do_not_keep_the_regression_from_its_end() -> None:
    _, predicted, errors = rows(5, 4000)
    # As of a bank of bushings alone: an error of twenty times the usual where hardly anybody is.
    predicted[0], errors[0] = 60.0, 20.0 * errors.std(axis=0)
    predicted[1], errors[1] = -30.0, -10.0 * errors.std(axis=0)
    found = ErrorSizes.fit(predicted, errors)
    unit = np.sqrt((predicted**2).mean(axis=0))
    both = np.hstack([predicted / unit, np.log1p(np.abs(predicted) / unit)])
    inputs = (both - both.mean(axis=0)) / both.std(axis=0)
    squared = np.maximum(errors**2, LEAST * (errors**2).mean(axis=0))
    design = np.column_stack([np.ones(len(inputs)), inputs])
    over = squared * np.exp(-design @ found.weights) - 1.0
    left = design.T @ over / len(design)
    left[1:] -= PENALTY * found.weights[1:]
    assert left == pytest.approx(np.zeros_like(left), abs=1e-5)
