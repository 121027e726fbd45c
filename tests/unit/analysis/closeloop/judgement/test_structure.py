"""A residual goes with a signal only if it does so in second after second."""

import numpy as np

from analysis.closeloop.judgement.structure import score_test

RATE, SECONDS = 40, 60
TIME = np.arange(RATE * SECONDS) / RATE
BLOCK = TIME.astype(int)
SPEED = np.sin(2.0 * TIME) + 0.5 * np.sin(3.3 * TIME)
SPAN = np.linalg.qr(np.column_stack([np.ones(len(TIME)), SPEED]))[0]


def chance(residual: np.ndarray) -> float:
    """Return how rare it is that the residual goes with the direction by luck."""
    residual = residual - SPAN @ (SPAN.T @ residual)
    columns = np.column_stack([np.tanh(20 * SPEED), np.abs(SPEED) * SPEED])
    return score_test(columns, SPAN, residual, slice(0, len(TIME)), BLOCK)[1]


def coloured(seed: int) -> np.ndarray:
    rng, out = np.random.default_rng(seed), np.empty(len(TIME))
    state = 0.0
    for i, white in enumerate(rng.standard_normal(len(TIME))):
        state = 0.9 * state + np.sqrt(0.19) * white
        out[i] = state
    return out


def test_friction_as_large_as_coloured_noise_is_seen() -> None:
    assert chance(coloured(1) + 1.0 * np.tanh(20 * SPEED)) < 1e-6


def test_coloured_noise_that_grows_with_speed_is_noise() -> None:
    low = [chance(coloured(seed) * (0.3 + np.abs(SPEED))) for seed in range(60)]
    assert min(low) > 1e-4
    assert np.mean(np.array(low) < 0.1) < 0.25


def test_too_few_seconds_say_nothing() -> None:
    few = slice(0, 5 * RATE)
    residual = np.tanh(20 * SPEED)
    assert score_test(residual[:, None], SPAN, residual, few, BLOCK) == (0.0, 1.0)
