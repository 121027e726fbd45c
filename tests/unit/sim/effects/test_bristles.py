"""Bristles of constant stiffness bend as LuGre's differential equation says."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim.effects.motion import bristles

#: Nm/rad, Nm: stiffness, friction when fast, excess; rad/s: speed at which it is lost.
STIFFNESS, FRICTION, EXCESS, SPEED = 500.0, 0.5, 0.3, 0.1


def velocity(time: np.ndarray | float) -> np.ndarray:
    return np.asarray(0.4 * np.sin(2 * np.pi * time))


def level(speed: np.ndarray) -> np.ndarray:
    return np.asarray(FRICTION + EXCESS * np.exp(-((speed / SPEED) ** 2)))


def test_they_hold_what_the_differential_equation_holds() -> None:
    time = np.arange(0.0, 2.0, 0.001)
    position = 0.4 * (1.0 - np.cos(2 * np.pi * time)) / (2 * np.pi)

    def rate(t: float, bent: np.ndarray) -> np.ndarray:
        speed = velocity(t)
        return np.asarray(speed - STIFFNESS * abs(speed) / level(speed) * bent)

    exact = solve_ivp(rate, (0.0, 2.0), [0.0], t_eval=time, max_step=1e-3, rtol=1e-8, atol=1e-12)
    levels = level(velocity(time))
    found = bristles(position, [slice(None)], FRICTION / STIFFNESS, levels / FRICTION)
    assert found * levels == pytest.approx(STIFFNESS * exact.y[0], abs=0.02 * FRICTION)


def test_every_piece_begins_unbent() -> None:
    position = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(0.0, -1.0, 50)])
    found = bristles(position, [slice(0, 50), slice(50, 100)], 0.1, np.ones(100))
    assert found[0] == found[50] == 0.0
    assert found[:50] == pytest.approx(-found[50:])
