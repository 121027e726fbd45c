"""A residual goes with a signal only if it does so in second after second."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.judgement.structure import score_test, structures
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.moved import moved

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


@pytest.mark.parametrize(("way", "seen"), [(0.003, False), (0.1, True)])
def test_friction_that_winds_up_over_presliding_s_way_leaves_no_structure(
    way: float, seen: bool, recording: Recording
) -> None:
    """Declared as Coulomb friction; over a longer way, rad, it is something else."""
    time = np.arange(3000) / 50.0
    phase = 2 * np.pi * 0.4 * time + 0.6 * np.sin(0.31 * time)
    elbow = 1.0 + 0.5 * np.sin(phase) * (0.7 + 0.3 * np.sin(0.23 * time))
    bare = moved(recording, np.column_stack([np.zeros(len(time)), elbow]), 50.0)
    bare = replace(bare, effort=bare.inverse, cache={})
    effort = np.array(bare.inverse)
    effort[:, 1] += unfitted(bare, 1).wound(way)
    effort[:, 1] += 0.05 * np.random.default_rng(4).standard_normal(len(time))
    loud = replace(bare, effort=bare.filtered(effort), cache={})
    friction, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004}
    columns = friction.columns(unfitted(loud, 1), theta)
    term = Term(joint=1, columns=columns, kept=(0,), theta=theta, effect=friction)
    model, rows = Model(loud, terms=(term,)), select_rows(loud, (0,))
    assert bool(structures(model, rows)[1]) is seen
    assert (explainable(model, rows).z > 2.0) is seen
