"""Undeclared effects with a known truth: own equations, none of the catalogue's code.

Each is the torque that the motor has to add, given the true motion and what the joint needs. The
forms are richer than the catalogue's: LuGre and Bouc-Wen states, a delayed and rectified reflex
with slow activation, a play that closes in time, a muscle whose stiffness comes back while it
rests. Internal states are integrated at several times the sampling rate.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

GRAVITY = 9.81


@dataclass
class Arm:
    """Truth of one session, SI units."""

    mass: float = 1.4
    lever: float = 0.15
    inertia: float = 0.045
    stiffness: float = 4.0
    damping: float = 0.4
    neutral: float = 1.1


@dataclass
class Motion:
    """One trial's true motion on the fine clock."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    posture: float
    #: Elevation of the upper arm: constant unless the trial moves the shoulder too, (3, n).
    shoulder: np.ndarray
    #: When the trial began on the session's clock, s.
    start: float
    step: float
    extra: dict[str, np.ndarray] = field(default_factory=dict)


def lugre(
    m: Motion,
    coulomb: Callable[[int], float] | float,
    extra: float = 0.0,
    stribeck: float = 0.1,
    sigma: float = 3000.0,
) -> np.ndarray:
    """LuGre friction (Canudas de Wit et al. 1995), integrated with an exponential step."""
    z, out = 0.0, np.empty(len(m.time))
    for i, v in enumerate(m.velocity):
        level = coulomb(i) if callable(coulomb) else coulomb
        g = level + extra * np.exp(-((v / stribeck) ** 2))
        rate = sigma * abs(v) / g
        goal = g * np.sign(v) / sigma
        new = goal + (z - goal) * np.exp(-rate * m.step) if v else z
        out[i] = sigma * new + 1.0 * (new - z) / m.step
        z = new
    return out


def coulomb_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return lugre(m, f)


def viscous_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return f * m.velocity / 2.0


def stribeck_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return lugre(m, 0.7 * f, extra=1.2 * f, stribeck=0.25)


def asymmetric_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    up = m.velocity > 0
    level = np.where(up, 1.2 * f, 0.5 * f)
    slope = np.where(up, 0.25, -0.05) * f
    return np.asarray(lugre(m, lambda i: level[i]) + slope * np.abs(m.velocity))


def load_dependent_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    load = np.abs(need)
    level = 0.2 * f + 0.25 * f * load
    return lugre(m, lambda i: level[i])


def position_dependent_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    level = f * (1.0 + 0.8 * np.sin(2.2 * (m.position - 0.6)))
    return lugre(m, lambda i: level[i])


def torque_gain(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return (1 / (1 + 0.2 * f) - 1.0) * need


def payload(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    mass, at = 0.45 * f, 0.24
    weight = mass * GRAVITY * at * np.cos(m.posture + m.position)
    return weight + mass * at**2 * m.acceleration


def added_inertia(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.12 * f * m.acceleration


def position_offset(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    # The recorded angle is larger than the true one; the spring's offset is q0's.
    pull = arm.mass * GRAVITY * arm.lever
    there = np.cos(m.posture + m.position - 0.3 * f)
    return pull * (there - np.cos(m.posture + m.position))


def nonlinear_stiffness(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 6.0 * f * (m.position - arm.neutral) ** 3


def end_range_torque(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.6 * f * (np.exp(np.maximum(0.0, m.position - 1.35) / 0.25) - 1.0)


def torque_ripple(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 1.4 * f * np.sin(14.0 * m.position + 0.4)


def time_delay(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.asarray(np.interp(m.time + 0.12 * f, m.time, need) - need)


def actuator_lag(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.asarray(0.11 * f * np.gradient(need, m.step))


def hysteresis(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Bouc-Wen, softer than LuGre: it takes a quarter of a radian to wind up."""
    z, out = 0.0, np.empty(len(m.time))
    for i, v in enumerate(m.velocity):
        z += m.step * (v - (0.7 * abs(v) * z + 0.3 * v * abs(z)) / 1.0) / 0.25
        z = min(max(z, -1.0), 1.0)
        out[i] = 1.5 * f * z
    return out


def stretch_reflex(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    drive = np.maximum(0.0, m.velocity - 0.5)
    delayed = np.interp(m.time - 0.05, m.time, drive)
    # Activation is slower than the nerve.
    out, state = np.empty(len(drive)), 0.0
    for i, u in enumerate(delayed):
        state += m.step * (u - state) / 0.02
        out[i] = 1.6 * f * state
    return out


def drift(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.asarray(0.03 * f * (m.start + m.time))


def torque_offset(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.full(len(m.time), 0.9 * f)


def joint_stiffness(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 2.5 * f * (m.position - 1.2)


def thixotropy(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Cross-bridges that form in 0.3 s of rest and break over half a radian of motion."""
    formed, out = 1.0, np.empty(len(m.time))
    for i, v in enumerate(m.velocity):
        formed += m.step * ((1.0 - formed) / 0.3 * (abs(v) < 0.02) - formed * abs(v) / 0.5)
        out[i] = 2.5 * f * formed * np.tanh(v / 0.02)
    return out


def cross_joint_coupling(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """A two-joint muscle: stiffer when it is longer, with some damping of its own."""
    length = m.shoulder[0] + 0.5
    return np.asarray(0.9 * f * (length + 0.2 * length**2) + 0.3 * f * m.shoulder[1])


EFFECTS = {
    e.__name__: e
    for e in (
        coulomb_friction, stribeck_friction, asymmetric_friction, load_dependent_friction,
        position_dependent_friction, torque_gain, payload, added_inertia, position_offset,
        nonlinear_stiffness, end_range_torque, torque_ripple, time_delay, actuator_lag, hysteresis,
        stretch_reflex, drift, thixotropy, cross_joint_coupling,
    )
}  # fmt: skip
#: What a declared stiffness, damping and neutral angle take in whole.
ABSORBED = {e.__name__: e for e in (viscous_friction, torque_offset, joint_stiffness)}


# Between motor and limb: the motor moves as prescribed and is recorded, the limb hangs on it.


def hung(m: Motion, arm: Arm, link: Callable[[float, float], float]) -> np.ndarray:
    """Return the motor's torque when the limb is driven through `link`(twist, its rate)."""
    q, v, out = float(m.position[0]), 0.0, np.empty(len(m.time))
    settle = int(1.5 / m.step)
    for i in range(-settle, len(out)):
        at = max(i, 0)
        twist, rate = m.position[at] - q, (m.velocity[at] if i >= 0 else 0.0) - v
        torque = link(twist, rate)
        weight = arm.mass * GRAVITY * arm.lever * np.cos(m.posture + q)
        own = weight + arm.stiffness * (q - arm.neutral) + arm.damping * v
        v += m.step * (torque - own) / arm.inertia
        q += m.step * v
        out[at] = torque
    return out


def series_elasticity(m: Motion, arm: Arm, f: float) -> np.ndarray:
    """A strap that is stiffer the more it is pulled, with some damping of its own."""
    return hung(m, arm, lambda x, rate: (36.0 * x + 150.0 * x**3) / f + 0.2 * rate)


def backlash(m: Motion, arm: Arm, f: float) -> np.ndarray:
    """A strap with slack: soft and lossy flanks; the limb falls through it when the load turns."""
    half = 0.05 * f

    def flank(x: float, rate: float) -> float:
        depth = x - min(max(x, -half), half)
        return 400.0 * depth + (4.0 * rate if depth else 0.0)

    return hung(m, arm, flank)


BETWEEN = {e.__name__: e for e in (series_elasticity, backlash)}


# Out of any catalogue.


def tremor(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 1.4 * f * np.sin(2 * np.pi * 6.3 * (m.start + m.time))


def quadratic_drag(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.asarray(0.6 * f * m.velocity * np.abs(m.velocity))


def muscle_bursts(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """A voluntary contraction at times of its own, seen by an EMG channel."""
    rng = np.random.default_rng(int(1e3 * m.start) + 17)
    emg = np.zeros(len(m.time))
    for centre in rng.uniform(0.3, m.time[-1], max(2, int(m.time[-1] / 1.5))):
        emg += np.exp(-(((m.time - centre) / 0.12) ** 2))
    m.extra["emg.biceps"] = emg
    return -2.0 * f * emg


def inverse_speed(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Damping that changes sign along the range: no passive part does that."""
    return 1.2 * f * m.velocity * np.sin(9.0 * m.position)


def mains_hum(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.8 * f * np.sin(2 * np.pi * 50.0 * (m.start + m.time))


def warming(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Grease that is stiff when cold: damping that falls in the course of the session."""
    m.extra["temperature"] = 40.0 - 18.0 * np.exp(-(m.start + m.time) / 40.0)
    return np.asarray(1.5 * f * np.exp(-(m.start + m.time) / 40.0) * m.velocity)


def co_contraction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Stiffness that comes and goes with an EMG of its own rhythm."""
    emg = np.maximum(0.0, np.sin(2 * np.pi * 0.45 * (m.start + m.time) + 0.7))
    m.extra["emg.triceps"] = emg
    return 4.0 * f * emg * (m.position - arm.neutral)


def push(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    """Somebody pushes once, in some of the trials."""
    rng = np.random.default_rng(int(1e3 * m.start) + 5)
    when = rng.uniform(0.8, m.time[-1] - 0.8)
    size = f * rng.choice([-1.0, 1.0]) if rng.random() < 0.4 or m.start < 5.0 else 0.0
    return np.asarray(size * np.exp(-(((m.time - when) / rng.uniform(0.15, 0.4)) ** 2)))


OUTSIDE = {
    e.__name__: e
    for e in (
        tremor, quadratic_drag, muscle_bursts, inverse_speed, mains_hum, warming, co_contraction,
        push,
    )
}  # fmt: skip
