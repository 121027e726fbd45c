"""Elastic torques of a joint beyond the declared linear spring.

Passive joint torque is flat in the middle of the range and steep towards its ends (Riener and
Edrich 1999); MuJoCo has polynomial `stiffness` and soft joint ranges for both.
"""

import numpy as np

from analysis.closeloop.catalogue.effect import (
    Columns,
    Effect,
    Estimate,
    Parameter,
    Theta,
    travel,
)
from analysis.closeloop.session.recording import Recording

#: Power that stands for an exponential, and the width of that over half the range of motion.
EXPONENTIAL, END_WIDTH = 0.0, 0.35


class JointStiffness(Effect):
    """A linear spring: K (q - q_ref)."""

    name = "joint_stiffness"
    complexity = 2
    signature = "the residual is a straight line against position, the same both ways"
    element = "joint/@stiffness"
    separating_trial = "move slowly through the whole range, both ways"
    includes = ("torque_offset",)
    lower = (0.0, -np.inf)

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        position = recording.position[:, joint]
        return {joint: np.column_stack([position, np.ones_like(position)])}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit, angle = _units(recording, joint)
        return {
            "stiffness": Parameter(unit=f"{unit}/{angle}", column=0),
            "torque_at_zero": Parameter(unit=unit, column=1),
        }


class NonlinearStiffness(Effect):
    """A hardening spring: K3 (q - c)^3."""

    name = "nonlinear_stiffness"
    complexity = 2
    signature = (
        "against position the residual is a curve with a bend at both ends, the same both ways"
    )
    element = "applied torque"
    separating_trial = "move slowly through a wider range, both ways"

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        middle, half = travel(recording, joint)
        return [{"centre": middle + half * share} for share in np.linspace(-1.4, 1.4, 15)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: ((recording.position[:, joint] - theta["centre"]) ** 3)[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return [{"centre": theta["centre"] + sign * 0.1 * scale} for sign in (-1, 1)]

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit, angle = _units(recording, joint)
        return {
            "cubic_stiffness": Parameter(unit=f"{unit}/{angle}3", column=0),
            "centre": Parameter(unit=angle, value=theta["centre"]),
        }


class EndRange(Effect):
    """A spring that only begins at an angle near one end: K max(0, q - a)^p, or exponential."""

    name = "end_range_torque"
    complexity = 3
    signature = (
        "the residual is flat over most of the range and rises at one end, the same both ways"
    )
    element = "applied torque"
    separating_trial = "move slowly beyond the angle where the torque begins, both ways"
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        middle, half = travel(recording, joint)
        return [
            {"side": side, "onset": middle + side * half * share, "power": power}
            for side in (-1.0, 1.0)
            for share in (0.3, 0.45, 0.6, 0.75, 0.87)
            for power in (1.0, 2.0, EXPONENTIAL)
        ]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        beyond = np.maximum(0.0, theta["side"] * (recording.position[:, joint] - theta["onset"]))
        if theta["power"] == EXPONENTIAL:
            _, half = travel(recording, joint)
            torque = np.expm1(np.minimum(beyond / (END_WIDTH * half), 20.0))
        else:
            torque = beyond ** theta["power"]
        return {joint: (theta["side"] * torque)[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return [{**theta, "onset": theta["onset"] + sign * 0.08 * scale} for sign in (-1, 1)]

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit, angle = _units(recording, joint)
        units = {EXPONENTIAL: unit, 1.0: f"{unit}/{angle}", 2.0: f"{unit}/{angle}2"}
        return {
            "stiffness": Parameter(unit=units[theta["power"]], column=0),
            "onset": Parameter(unit=angle, value=theta["onset"]),
            "side": Parameter(unit="1", value=theta["side"]),
            # 1 or 2; 0 stands for an exponential of the width below.
            "power": Parameter(unit="1", value=theta["power"]),
            "width": Parameter(unit=angle, value=END_WIDTH * travel(recording, joint)[1]),
        }


def _units(recording: Recording, joint: int) -> tuple[str, str]:
    name = recording.device.joints[joint]
    return recording.device.unit(name), recording.device.angle_unit(name)
