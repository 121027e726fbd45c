"""Between motor and limb: compliance, play, and friction that winds up before it slides.

Spong 1987 (elastic joints); Nordin and Gutman 2002 (backlash); Dahl 1968 (friction that depends on
the way since reversal).
"""

import itertools

import numpy as np

from analysis.closeloop.catalogue.effect import (
    Columns,
    Effect,
    Estimate,
    Parameter,
    Theta,
    scaled,
    travel,
)
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import lagged, lowpass


class SeriesElasticity(Effect):
    """A spring between the recorded position and the limb: the limb is torque / k behind.

    To first order the balance changes by -(M u'' + D u' + (K + g') u) / k for the torque u.
    """

    name = "series_elasticity"
    complexity = 1
    signature = (
        "the residual follows the second derivative of the torque: ringing after fast changes"
    )
    element = "applied torque"
    separating_trial = "push the joint with short pulses, and record the limb's own angle"
    lower = (0.0,)
    uses_estimate = True

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: -_felt(recording, joint, estimate.prediction[:, joint], estimate)[:, None]}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit, angle = _units(recording, joint)
        return {"compliance": Parameter(unit=f"{angle}/{unit}", column=0)}


class Backlash(Effect):
    """Play between motor and limb: the limb lies on the side to which the load pulls it.

    The recorded motor is gap / 2 times the load's side ahead, so the balance lacks
    -(M s'' + D s' + (K + g') s) gap / 2.
    """

    name = "backlash"
    complexity = 2
    signature = "the residual steps where the load changes sign, not where the velocity does"
    element = "applied torque"
    separating_trial = "move to and fro where the load changes sign, and again with a preload"
    lower = (0.0,)
    uses_estimate = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"width": share, "late": late}
            for share in (0.02, 0.06, 0.15, 0.3)
            for late in (0.0, 0.03, 0.08, 0.16)
        ]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        load = estimate.prediction[:, joint]
        spread = max(float(np.quantile(np.abs(load), 0.95)), 1e-9)
        side = np.tanh(load / (theta["width"] * spread))
        for piece in recording.slices:
            if theta["late"]:
                side[piece] = lagged(side[piece], theta["late"], recording.rate)
            side[piece] = lowpass(side[piece], recording.sampling.cutoff, recording.rate)
        return {joint: -_felt(recording, joint, side, estimate)[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "width", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        angle = _units(recording, joint)[1]
        return {"gap": Parameter(unit=angle, column=0, scale=2.0)}


class Hysteresis(Effect):
    """Friction that builds up over a distance after each reversal (Dahl's model)."""

    name = "hysteresis"
    complexity = 2
    signature = "after each reversal the residual rises over the same distance, not the same time"
    element = "applied torque"
    separating_trial = "move to and fro with small and with large amplitudes at one speed"
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"distance": share} for share in (0.03, 0.06, 0.12, 0.25, 0.5)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        _, half = travel(recording, joint)
        return {joint: dahl(recording, joint, theta["distance"] * half)[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "distance", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit, angle = _units(recording, joint)
        _, half = travel(recording, joint)
        return {
            "torque": Parameter(unit=unit, column=0),
            "distance": Parameter(unit=angle, value=theta["distance"] * half),
        }


def dahl(recording: Recording, joint: int, distance: float) -> np.ndarray:
    """Return Dahl's friction state in -1 to 1 along the recorded motion, (n,).

    dz/dq = (1 - sign(v) z) / distance has a closed form between reversals; each piece starts at 0.
    """
    state = np.zeros(len(recording.time))
    for piece in recording.slices:
        position = recording.position[piece, joint]
        sign = np.sign(np.diff(position, prepend=position[0]))
        turns = np.flatnonzero(np.diff(sign)) + 1
        bounds = [0, *turns, len(position)]
        part, z = np.zeros(len(position)), 0.0
        for start, stop in itertools.pairwise(bounds):
            s = sign[start]
            way = np.abs(position[start:stop] - position[max(start - 1, 0)])
            part[start:stop] = s + (z - s) * np.exp(-way / distance) if s else z
            z = part[stop - 1]
        state[piece] = part
    return state


def _felt(recording: Recording, joint: int, ahead: np.ndarray, estimate: Estimate) -> np.ndarray:
    """Return the torque that a move by `ahead` (rad or m, (n,)) changes: M, D and K of it."""
    rate, twice = np.empty_like(ahead), np.empty_like(ahead)
    for piece in recording.slices:
        rate[piece] = np.gradient(ahead[piece], 1.0 / recording.rate)
        twice[piece] = np.gradient(rate[piece], 1.0 / recording.rate)
    slope = estimate.stiffness[joint] + _static_slope(recording, joint)
    inertia = recording.own_inertia[:, joint]
    return np.asarray(inertia * twice + estimate.damping[joint] * rate + slope * ahead)


def _static_slope(recording: Recording, joint: int) -> np.ndarray:
    """Return the slope of gravity and declared springs over the joint's own position, (n,)."""
    return np.asarray(recording.secant(joint, 1e-4)[:, joint])


def _units(recording: Recording, joint: int) -> tuple[str, str]:
    name = recording.device.joints[joint]
    return recording.device.unit(name), recording.device.angle_unit(name)
