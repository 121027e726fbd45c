"""Friction: torque against the direction of motion, and what makes it vary.

Armstrong-Helouvry, Dupont and Canudas de Wit 1994 (survey of friction models); direction-dependent
friction as found in ball screws (Janot, Gautier and Brunot 2019); dependence on load and position
after Swevers, Verdonck and De Schutter 2007. MuJoCo has `frictionloss` and `damping`; what else
varies enters as an applied torque.
"""

import numpy as np

from analysis.closeloop.catalogue.effect import (
    Columns,
    Effect,
    Estimate,
    Parameter,
    Theta,
    direction,
    scaled,
    travel,
)
from analysis.closeloop.session.recording import Recording

#: Width of the passage through zero velocity, over the top speed.
SMOOTH = (0.004, 0.02, 0.06)


def _smooth_grid() -> list[Theta]:
    return [{"smooth": share} for share in SMOOTH]


class Coulomb(Effect):
    """Constant torque against the motion: F tanh(v / v0)."""

    name = "coulomb_friction"
    complexity = 1
    signature = "the residual steps with the sign of the velocity, equally high at every speed"
    element = "joint/@frictionloss"
    separating_trial = "move to and fro through the same range at two constant speeds"
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return _smooth_grid()

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: direction(recording, joint, theta["smooth"])[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "smooth", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {"torque": Parameter(unit=_unit(recording, joint), column=0)}


class Viscous(Effect):
    """Torque proportional to velocity."""

    name = "viscous_friction"
    complexity = 1
    signature = "the residual is a straight line through zero against velocity"
    element = "joint/@damping"
    separating_trial = "move to and fro through the same range at three speeds"
    lower = (0.0,)

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: recording.velocity[:, [joint]]}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {"damping": Parameter(unit=_damping_unit(recording, joint), column=0)}


class Stribeck(Effect):
    """Coulomb friction that is higher when slow: (F + dF exp(-(v / vs)^2)) sign(v)."""

    name = "stribeck_friction"
    complexity = 3
    signature = "against velocity, the residual steps at zero and falls as the speed grows"
    element = "applied torque"
    separating_trial = "creep through the range, much slower than the slowest trial, both ways"
    includes = ("coulomb_friction",)
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"smooth": smooth, "speed": speed}
            for smooth in SMOOTH[:2]
            for speed in (0.03, 0.06, 0.12, 0.24, 0.4)
            if speed > 2 * smooth
        ]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        sign = direction(recording, joint, theta["smooth"])
        speed = recording.velocity[:, joint] / (theta["speed"] * recording.top_speed[joint])
        return {joint: np.column_stack([sign, sign * np.exp(-(speed**2))])}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "speed", scale) + scaled(theta, "smooth", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit = _unit(recording, joint)
        speed = theta["speed"] * float(recording.top_speed[joint])
        return {
            "torque": Parameter(unit=unit, column=0),
            "breakaway_excess": Parameter(unit=unit, column=1),
            "stribeck_velocity": Parameter(unit=_speed_unit(recording, joint), value=speed),
        }


class Asymmetric(Effect):
    """Another Coulomb and another viscous friction in each direction.

    Mean and half difference of the two levels are the coefficients: the half difference goes with
    |sign(v)|, a constant wherever the joint moves, which a neutral angle or an offset takes in
    whole. Then only the mean is known, and the slopes must tell the directions apart.
    """

    name = "asymmetric_friction"
    complexity = 3
    signature = "steps and slopes against velocity differ between the two directions"
    element = "applied torque"
    separating_trial = "move to and fro at three speeds, with rests at both ends"
    includes = ("coulomb_friction",)
    lower = (0.0, -np.inf, -np.inf)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"smooth": smooth, "viscous": viscous} for smooth in SMOOTH for viscous in (0.0, 1.0)
        ]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        sign = direction(recording, joint, theta["smooth"])
        columns = [sign, np.abs(sign)]
        if theta["viscous"]:
            columns.append(np.abs(recording.velocity[:, joint]))
        return {joint: np.column_stack(columns)}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "smooth", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit = _unit(recording, joint)
        found = {
            "torque_positive": Parameter(unit=unit, column=0, also=(1, 1.0)),
            "torque_negative": Parameter(unit=unit, column=0, also=(1, -1.0)),
        }
        if theta["viscous"]:
            found["viscous_difference"] = Parameter(
                unit=_damping_unit(recording, joint), column=2, scale=2.0
            )
        return found


class LoadDependent(Effect):
    """Friction that grows with the joint's load: (F + mu |load|) sign(v)."""

    name = "load_dependent_friction"
    complexity = 2
    signature = "the step with the velocity's sign grows with the torque that the joint carries"
    element = "applied torque"
    separating_trial = "repeat one movement with a known mass attached"
    includes = ("coulomb_friction",)
    lower = (0.0,)
    uses_estimate = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"smooth": smooth, "load": load} for smooth in SMOOTH[:2] for load in (0, 1, 2)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        sign = direction(recording, joint, theta["smooth"])
        loads = (
            recording.static[:, joint],
            estimate.prediction[:, joint],
            np.nan_to_num(recording.effort[:, joint]),
        )
        load = np.abs(loads[int(theta["load"])])
        return {joint: np.column_stack([sign, sign * load])}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        return {
            "torque": Parameter(unit=_unit(recording, joint), column=0),
            "load_share": Parameter(unit="1", column=1),
        }


class PositionDependent(Effect):
    """Friction that varies along the range: (F0 + F1 x + F2 x^2) sign(v), x over half the range."""

    name = "position_dependent_friction"
    complexity = 3
    signature = "the step with the velocity's sign changes along the range"
    element = "applied torque"
    separating_trial = "repeat one movement in another posture, so that load and position part"
    includes = ("coulomb_friction",)
    lower = (0.0, -np.inf, -np.inf)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return _smooth_grid()[:2]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        sign = direction(recording, joint, theta["smooth"])
        middle, half = travel(recording, joint)
        x = (recording.position[:, joint] - middle) / half
        return {joint: np.column_stack([sign, sign * x, sign * x**2])}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        unit = _unit(recording, joint)
        middle, half = travel(recording, joint)
        angle = recording.device.angle_unit(recording.device.joints[joint])
        return {
            "torque_middle": Parameter(unit=unit, column=0),
            "torque_slope": Parameter(unit=f"{unit}/{angle}", column=1, scale=1 / half),
            "torque_curvature": Parameter(unit=f"{unit}/{angle}2", column=2, scale=1 / half**2),
            "middle": Parameter(unit=angle, value=middle),
        }


def _unit(recording: Recording, joint: int) -> str:
    return recording.device.unit(recording.device.joints[joint])


def _speed_unit(recording: Recording, joint: int) -> str:
    return recording.device.angle_unit(recording.device.joints[joint]) + "/s"


def _damping_unit(recording: Recording, joint: int) -> str:
    return "Nm s/rad" if _unit(recording, joint) == "Nm" else "N s/m"
