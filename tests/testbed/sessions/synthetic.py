"""Synthetic measured sessions with a known truth: own equations, none of the catalogue's code.

A forearm on a held upper arm: I q'' + m g l cos(posture + q) + K (q - q0) + D q' + effect = effort.
The motion is prescribed (minimum-jerk sweeps to and fro), internal states are integrated at 4 times
the sampling rate, and the sensors quantise, filter, jitter and add coloured noise. What is
undeclared comes from `tests/testbed/sessions/effects.py`.

The generator of random numbers is seeded by the seed and the effects together, so no two sessions
share motion or noise. Seeds below 6000 are for developing; 6000 and above are for measuring.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.testbed.sessions.effects import (
    ABSORBED,
    BETWEEN,
    EFFECTS,
    GRAVITY,
    OUTSIDE,
    Arm,
    Motion,
)

UPPER_ARM = 0.3
RATE = 500.0
SUBSTEPS = 4
SPEEDS = (0.35, 0.8, 1.6, 3.0)
POSTURES = (-1.2, 0.1)


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
      <body name="forearm" pos="{UPPER_ARM} 0 0">
        <joint name="elbow" type="hinge" axis="0 -1 0" frictionloss="{frictionloss}"/>
        <inertial pos="{arm.lever} 0 0" mass="{arm.mass}"
                  diaginertia="{central} {central} {central}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def sweeps(
    rng: np.random.Generator,
    speed: float,
    posture: float,
    start: float,
    *,
    rest: float = 0.25,
    shoulder: float = 0.0,
    rate: float = RATE,
    seconds: float = 0.0,
) -> Motion:
    """Return minimum-jerk sweeps to and fro with rests, about `speed` rad/s at their peak.

    Args:
        rng: corners and rests.
        speed: rad/s.
        posture: elevation of the upper arm, rad.
        start: when the trial begins, s.
        rest: mean length of a rest, s.
        shoulder: how far the upper arm swings at its own slow rhythm, rad.
        rate: of the sensors, Hz.
        seconds: least length; more sweeps follow until it is reached.
    """
    step = 1.0 / (rate * SUBSTEPS)
    low, high = 0.35 + 0.1 * rng.random(), 1.75 + 0.1 * rng.random()
    count = 2 if speed < 0.5 else 4 if speed < 2 else 6
    position: list[np.ndarray] = []
    at, number = low, 0
    while number < count or sum(map(len, position)) * step < seconds:
        goal = (high if number % 2 == 0 else low) + 0.1 * rng.standard_normal()
        duration = 1.875 * abs(goal - at) / speed
        s = np.arange(0.0, 1.0, step / duration)
        position.append(at + (goal - at) * (10 * s**3 - 15 * s**4 + 6 * s**5))
        position.append(np.full(int((rest * (0.5 + rng.random())) / step), goal))
        at, number = goal, number + 1
    q = np.concatenate(position)
    # The controller is not a mathematician: its corners are a little round.
    width = int(0.03 / step)
    kernel = np.hanning(width)
    q = np.convolve(np.pad(q, width, mode="edge"), kernel / kernel.sum(), mode="same")[width:-width]
    v = np.gradient(q, step)
    a = np.gradient(v, step)
    time = np.arange(len(q)) * step
    w = 2 * np.pi * 0.37
    swing = np.array([np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)])
    upper = shoulder * swing
    upper[0] += posture
    return Motion(time, q, v, a, posture, upper, start, step)


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
    rate: float = RATE,
    seconds: float = 0.0,
) -> Arm:
    """Write a session of every speed in every posture; return its truth.

    The effect's root mean square is at least 3 times the noise's at `size` 1. Without a declared
    impedance the arm has none either. Sessions with thixotropy have longer rests, and those with
    coupling move the shoulder: no other could show them.
    """
    truth = ",".join(effects) if declared else ",".join(("bare", *effects))
    rng = np.random.default_rng(np.random.SeedSequence([seed, *truth.encode()]))
    arm = Arm(
        stiffness=3.0 + 3.0 * rng.random(),
        damping=0.3 + 0.3 * rng.random(),
        neutral=0.9 + 0.4 * rng.random(),
    )
    if not declared:
        arm = replace(arm, stiffness=0.0, damping=0.0)
    how = {
        "rest": 0.8 if "thixotropy" in effects else 0.25,
        "shoulder": 0.35 if "cross_joint_coupling" in effects else 0.0,
        "rate": rate,
        "seconds": seconds,
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "device.xml").write_text(mjcf(arm))
    entries, clock = [], 3.0
    strength = size * (0.8 + 0.6 * rng.random())
    for posture in postures:
        for speed in speeds:
            m = sweeps(rng, speed * (0.9 + 0.2 * rng.random()), posture, clock, **how)
            file = f"p{postures.index(posture)}_v{speeds.index(speed)}.csv"
            _write_trial(folder / file, m, arm, effects, strength, noise, rng)
            entries.append({"file": file, "group": f"posture {posture}, speed {speed}"})
            clock += float(m.time[-1]) + 2.0
    if holdout:
        m = sweeps(rng, 1.1, float(np.mean(postures)), clock, **how)
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
    upper, upper_speed, upper_acceleration = m.shoulder
    need = (
        arm.inertia * (m.acceleration + upper_acceleration)
        + arm.mass * GRAVITY * arm.lever * np.cos(upper + m.position)
        + arm.mass
        * arm.lever
        * UPPER_ARM
        * (upper_acceleration * np.cos(m.position) + upper_speed**2 * np.sin(m.position))
        + arm.stiffness * (m.position - arm.neutral)
        + arm.damping * m.velocity
    )
    effort = need.copy()
    for name in effects:
        if name in BETWEEN:
            effort = BETWEEN[name](m, arm, size)
        else:
            effort += (EFFECTS | ABSORBED | OUTSIDE)[name](m, arm, need, 0.6 * size)
    every = slice(None, None, SUBSTEPS)
    time, interval = m.time[every], SUBSTEPS * m.step
    jitter = np.clip(rng.normal(0.0, 0.05 * interval, len(time)), -0.3 * interval, 0.3 * interval)
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
        "shoulder.position": np.round(np.interp(time, m.time, upper) / encoder) * encoder
        if np.ptp(upper)
        else upper[every],
        "elbow.position": np.round(position / encoder) * encoder,
        "elbow.effort": np.round(torque / adc) * adc,
    }
    for name, signal in m.extra.items():
        columns[name] = np.interp(time, m.time, signal)
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
