"""Actuator and sensors: what the effort or position channel does to a true torque or angle.

Gain, offset, ripple, delay and lag of a drive (Pfeiffer and Holzl 1995 for ripple; MuJoCo's
actuator gain, bias, delay and first-order `dyntype="filter"`).
"""

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


class TorqueOffset(Effect):
    """A constant torque."""

    name = "torque_offset"
    complexity = 1
    signature = "the residual has the same mean everywhere"
    element = "actuator/general/@biasprm"
    separating_trial = "hold still in five postures"

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: np.ones((len(recording.time), 1))}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {"torque": Parameter(unit=_unit(recording, joint), column=0)}


class TorqueGain(Effect):
    """The joint feels gain times the effort; the whole balance is divided by the gain."""

    name = "torque_gain"
    complexity = 1
    signature = "the residual is a copy of the declared torque"
    element = "actuator/general/@gainprm"
    separating_trial = "hold a known mass still in two postures"

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: recording.inverse[:, [joint]]}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        # `tracing` turns the coefficient c into the gain 1 / (1 + c).
        return {"gain": Parameter(unit="1", column=0)}


class TorqueRipple(Effect):
    """A torque that is periodic in position: cogging, gear teeth, commutation."""

    name = "torque_ripple"
    complexity = 3
    signature = "the residual is periodic in position, the same at every speed"
    element = "applied torque"
    separating_trial = "move slowly and evenly through the range, both ways"

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        """Return the orders that stand out in the residual's spectrum over position."""
        residual = estimate.residual[:, joint]
        good = np.isfinite(residual) & (
            np.abs(recording.velocity[:, joint]) > 2 * recording.rest_speed[joint]
        )
        _, half = travel(recording, joint)
        if good.sum() < 200:
            return []
        step = max(1, int(good.sum() / 8000))
        position, torque = recording.position[good, joint][::step], residual[good][::step]
        first, step_order = 1.5 * np.pi / half, 0.25 * np.pi / half
        orders = first + step_order * np.arange(234)
        # Turning each sample's phase on by one order is much cheaper than another exponential.
        turning = (torque - torque.mean()) * np.exp(-1j * first * position)
        turn = np.exp(-1j * step_order * position)
        power = np.empty(len(orders))
        for number in range(len(orders)):
            power[number] = abs(turning.sum())
            turning *= turn
        peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
        best = peaks[np.argsort(power[peaks])[::-1][:4]]
        return [
            {"order": float(orders[peak] + shift * np.pi / half)}
            for peak in best
            for shift in (-0.12, 0.0, 0.12)
        ]

    uses_estimate = True

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        angle = theta["order"] * recording.position[:, joint]
        return {joint: np.column_stack([np.cos(angle), np.sin(angle)])}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "order", scale, step=0.01)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit = _unit(recording, joint)
        angle = recording.device.angle_unit(recording.device.joints[joint])
        return {
            "cosine": Parameter(unit=unit, column=0),
            "sine": Parameter(unit=unit, column=1),
            "order": Parameter(unit=f"1/{angle}", value=theta["order"]),
        }


class PositionOffset(Effect):
    """A wrong zero of the encoder: gravity is computed in the wrong place."""

    name = "position_offset"
    complexity = 1
    signature = "the residual follows the slope of gravity over posture"
    element = "joint/@ref"
    separating_trial = "hold still in five postures all over the range"
    uses_estimate = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"offset": offset} for offset in (-0.3, -0.1, -0.03, 0.03, 0.1, 0.3)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        # Recorded position = true position + offset, so the torque is that of q - offset. The
        # secant over the offset itself is exact once both agree.
        secant = recording.secant(joint, -theta["offset"])
        return {number: -secant[:, [number]] for number in recording.joints}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "offset", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit = recording.device.angle_unit(recording.device.joints[joint])
        return {"offset": Parameter(unit=unit, column=0)}


class TimeDelay(Effect):
    """The joint feels the effort a fixed time later; negative if the encoder is the late one."""

    name = "time_delay"
    complexity = 1
    signature = (
        "the residual is the derivative of the torque: it grows with frequency, not amplitude"
    )
    element = "applied torque (delay)"
    separating_trial = "shake the joint fast, with a small amplitude"
    channel = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"delay": sign * delay}
            for delay in (0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.065)
            for sign in (-1.0, 1.0)
        ]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "delay", scale, step=0.25)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {"delay": Parameter(unit="s", value=theta["delay"])}


class ActuatorLag(Effect):
    """A first-order lag: of the torque behind the command, or (negative) of the effort's sensor."""

    name = "actuator_lag"
    complexity = 1
    signature = "fast parts of the torque are missing and late, slow ones are not"
    element = "actuator/general/@dynprm (filter)"
    separating_trial = "sweep the joint from slow to fast with a small amplitude"
    channel = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"time_constant": sign * constant}
            for constant in (0.003, 0.006, 0.011, 0.02, 0.035, 0.06, 0.1, 0.16)
            for sign in (-1.0, 1.0)
        ]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "time_constant", scale, step=0.25)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {"time_constant": Parameter(unit="s", value=theta["time_constant"])}


class Drift(Effect):
    """A torque that creeps over the session: linear in the session's clock, or levelling off."""

    name = "drift"
    complexity = 2
    signature = "the residual changes from trial to trial in the order they were run"
    element = "applied torque"
    separating_trial = "repeat the first trial at the end of the session"

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"level_off": share} for share in (10.0, 0.6, 0.2)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        time = recording.time - recording.time.min()
        constant = theta["level_off"] * max(float(time.max()), 1e-9)
        return {joint: (constant * (1.0 - np.exp(-time / constant)))[:, None]}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        length = float(np.ptp(recording.time))
        return {
            "rate": Parameter(unit=f"{_unit(recording, joint)}/s", column=0),
            "time_constant": Parameter(unit="s", value=theta["level_off"] * length),
        }


def _unit(recording: Recording, joint: int) -> str:
    return recording.device.unit(recording.device.joints[joint])
