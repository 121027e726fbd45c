"""Left-out rows show an effect by how residuals go with it, before their losses do."""

import numpy as np

from analysis.closeloop.identification.arms.shared import nested_z
from analysis.closeloop.identification.balance.regression import compare

#: Seconds, rows a second, and folds of a short trial.
SECONDS, ROWS, FOLDS = 14, 24, 6
BLOCK = np.repeat(np.arange(SECONDS), ROWS)


def left_out(rng: np.random.Generator, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Return held-out residuals without and with a constant that the other folds give."""
    noise = rng.standard_normal(SECONDS)[BLOCK] + rng.standard_normal(len(BLOCK))
    without = offset + noise
    fold = np.arange(len(BLOCK)) * FOLDS // len(BLOCK)
    others = np.array([without[fold != number].mean() for number in range(FOLDS)])
    return without, without - others[fold]


def shown(offset: float, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Return the statistic of nested fits and that of losses, over seeds."""
    nested, losses = [], []
    for seed in seeds:
        without, beside = left_out(np.random.default_rng(seed), offset)
        nested.append(nested_z(without, beside, BLOCK))
        gain, error = compare(*(np.bincount(BLOCK, left**2) for left in (without, beside)))
        losses.append(gain / error)
    return np.array(nested), np.array(losses)


def test_a_short_trial_shows_an_offset_that_its_losses_alone_would_miss() -> None:
    nested, losses = shown(1.6, range(60))
    assert np.median(nested) > 4.0 > 3.0 > np.median(losses)


def test_noise_shows_no_offset() -> None:
    nested, _ = shown(0.0, range(400))
    assert np.mean(nested) < 0.0
    assert np.mean(nested > 2.0) < 0.05
    assert np.mean(nested > 3.0) < 0.01
