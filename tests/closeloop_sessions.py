"""Synthetic measured sessions with a known truth: own equations, none of the catalogue's code.

A forearm on a held upper arm: I q'' + m g l cos(posture + q) + K (q - q0) + D q' + effect = effort.
The motion is prescribed (minimum-jerk sweeps to and fro), internal states are integrated at 4 times
the sampling rate, and the sensors quantise, filter, jitter and add coloured noise. The forms are
richer than the catalogue's: LuGre bristles for friction, a delayed rectified reflex, a smooth play.

Seeds 0 to 99 are for developing; 1000 and above are for measuring and were not looked at before.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

GRAVITY = 9.81
RATE = 500.0
SUBSTEPS = 4
SPEEDS = (0.35, 0.8, 1.6, 3.0)
POSTURES = (-1.2, 0.1)


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
    #: When the trial began on the session's clock, s.
    start: float
    step: float
    extra: dict[str, np.ndarray] = field(default_factory=dict)


def mjcf(arm: Arm, *, frictionloss: float = 0.0) -> str:
    """Return the declared device: upper arm and forearm in the vertical plane."""
    central = arm.inertia - arm.mass * arm.lever**2
    return f"""<mujoco model="forearm">
  <compiler angle="radian"/>
  <option gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <body name="upper_arm">
      <joint name="shoulder" type="hinge" axis="0 -1 0"/>
      <inertial pos="0.15 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
      <body name="forearm" pos="0.3 0 0">
        <joint name="elbow" type="hinge" axis="0 -1 0" frictionloss="{frictionloss}"/>
        <inertial pos="{arm.lever} 0 0" mass="{arm.mass}"
                  diaginertia="{central} {central} {central}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def sweeps(rng: np.random.Generator, speed: float, posture: float, start: float) -> Motion:
    """Return minimum-jerk sweeps to and fro with short rests, about `speed` rad/s at their peak."""
    step = 1.0 / (RATE * SUBSTEPS)
    low, high = 0.35 + 0.1 * rng.random(), 1.75 + 0.1 * rng.random()
    count = 2 if speed < 0.5 else 4 if speed < 2 else 6
    position, t_rest = [], 0.25
    at = low
    for number in range(count):
        goal = (high if number % 2 == 0 else low) + 0.1 * rng.standard_normal()
        duration = 1.875 * abs(goal - at) / speed
        s = np.arange(0.0, 1.0, step / duration)
        position.append(at + (goal - at) * (10 * s**3 - 15 * s**4 + 6 * s**5))
        position.append(np.full(int((t_rest * (0.5 + rng.random())) / step), goal))
        at = goal
    q = np.concatenate(position)
    # The controller is not a mathematician: its corners are a little round.
    width = int(0.03 / step)
    kernel = np.hanning(width)
    q = np.convolve(np.pad(q, width, mode="edge"), kernel / kernel.sum(), mode="same")[width:-width]
    v = np.gradient(q, step)
    a = np.gradient(v, step)
    return Motion(np.arange(len(q)) * step, q, v, a, posture, start, step)


# Effects: the torque that the motor has to add, given the true motion and what the joint needs.


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
    return lugre(m, lambda i: level[i]) + np.where(up, 0.25, -0.05) * f * np.abs(m.velocity)


def load_dependent_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    load = np.abs(need)
    level = 0.2 * f + 0.25 * f * load
    return lugre(m, lambda i: level[i])


def position_dependent_friction(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    level = f * (1.0 + 0.8 * np.sin(2.2 * (m.position - 0.6)))
    return lugre(m, lambda i: level[i])


def torque_gain(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return (1 / (1 + 0.15 * f) - 1.0) * need


def payload(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    mass, at = 0.45 * f, 0.24
    weight = mass * GRAVITY * at * np.cos(m.posture + m.position)
    return weight + mass * at**2 * m.acceleration


def added_inertia(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.08 * f * m.acceleration


def position_offset(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    # The recorded angle is larger than the true one; the spring's offset is q0's.
    pull = arm.mass * GRAVITY * arm.lever
    there = np.cos(m.posture + m.position - 0.3 * f)
    return pull * (there - np.cos(m.posture + m.position))


def nonlinear_stiffness(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 6.0 * f * (m.position - arm.neutral) ** 3


def end_range_torque(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 4.0 * f * (np.exp(np.maximum(0.0, m.position - 1.35) / 0.25) - 1.0)


def torque_ripple(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 1.4 * f * np.sin(14.0 * m.position + 0.4)


def time_delay(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return np.interp(m.time + 0.03 * f, m.time, need) - need


def actuator_lag(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.05 * f * np.gradient(need, m.step)


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
    return 0.03 * f * (m.start + m.time)


EFFECTS = {
    e.__name__: e
    for e in (
        coulomb_friction, stribeck_friction, asymmetric_friction, load_dependent_friction,
        position_dependent_friction, torque_gain, payload, added_inertia, position_offset,
        nonlinear_stiffness, end_range_torque, torque_ripple, time_delay, actuator_lag, hysteresis,
        stretch_reflex, drift,
    )
}  # fmt: skip


# Out of any catalogue.


def tremor(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 1.4 * f * np.sin(2 * np.pi * 6.3 * (m.start + m.time))


def quadratic_drag(m: Motion, arm: Arm, need: np.ndarray, f: float) -> np.ndarray:
    return 0.6 * f * m.velocity * np.abs(m.velocity)


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


OUTSIDE = {e.__name__: e for e in (tremor, quadratic_drag, muscle_bursts, inverse_speed)}


def write_session(
    folder: Path,
    seed: int,
    effects: tuple[str, ...] = (),
    *,
    size: float = 1.0,
    noise: float = 0.06,
    declared: bool = True,
    holdout: bool = True,
    speeds: tuple[float, ...] = SPEEDS,
    postures: tuple[float, ...] = POSTURES,
) -> Arm:
    """Write a session of every speed in every posture; return its truth.

    The effect's root mean square is at least 3 times the noise's at `size` 1.
    """
    rng = np.random.default_rng(seed)
    arm = Arm(
        stiffness=3.0 + 3.0 * rng.random(),
        damping=0.3 + 0.3 * rng.random(),
        neutral=0.9 + 0.4 * rng.random(),
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "device.xml").write_text(mjcf(arm))
    entries, clock = [], 3.0
    strength = size * (0.8 + 0.6 * rng.random())
    for posture in postures:
        for speed in speeds:
            m = sweeps(rng, speed * (0.9 + 0.2 * rng.random()), posture, clock)
            file = f"p{postures.index(posture)}_v{speeds.index(speed)}.csv"
            _write_trial(folder / file, m, arm, effects, strength, noise, rng)
            entries.append({"file": file, "group": f"posture {posture}, speed {speed}"})
            clock += float(m.time[-1]) + 2.0
    if holdout:
        m = sweeps(rng, 1.1, float(np.mean(postures)), clock)
        _write_trial(folder / "holdout.csv", m, arm, effects, strength, noise, rng)
        entries.append({"file": "holdout.csv", "role": "holdout"})
    session = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}]
        if declared
        else [],
        "trials": entries,
    }
    (folder / "session.json").write_text(json.dumps(session, indent=1))
    return arm


def _write_trial(
    path: Path,
    m: Motion,
    arm: Arm,
    effects: tuple[str, ...],
    size: float,
    noise: float,
    rng: np.random.Generator,
) -> None:
    need = (
        arm.inertia * m.acceleration
        + arm.mass * GRAVITY * arm.lever * np.cos(m.posture + m.position)
        + arm.stiffness * (m.position - arm.neutral)
        + arm.damping * m.velocity
    )
    effort = need.copy()
    for name in effects:
        effort += (EFFECTS | OUTSIDE)[name](m, arm, need, 0.6 * size)
    every = slice(None, None, SUBSTEPS)
    time = m.time[every]
    jitter = np.clip(rng.normal(0.0, 0.05 / RATE, len(time)), -0.3 / RATE, 0.3 / RATE)
    time = time + jitter
    position = np.interp(time, m.time, m.position)
    torque = np.interp(time, m.time, effort)
    white = rng.standard_normal(len(time))
    coloured = np.empty(len(time))
    state = 0.0
    for i, w in enumerate(rng.standard_normal(len(time))):
        state = 0.9 * state + np.sqrt(1 - 0.81) * w
        coloured[i] = state
    torque += noise * (0.8 * white + 0.6 * coloured)
    encoder, adc = 2 * np.pi / 2**16, 0.01
    columns = {
        "time": m.start + time,
        "shoulder.position": np.full(len(time), m.posture),
        "elbow.position": np.round(position / encoder) * encoder,
        "elbow.effort": np.round(torque / adc) * adc,
    }
    for name, signal in m.extra.items():
        columns[name] = np.interp(time, m.time, signal)
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
