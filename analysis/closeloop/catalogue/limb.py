"""What a living limb adds: reflexes, stiffness after rest, and torque passed between joints.

Stretch reflex after Lance 1980 and the threshold models of Koo and Mak 2006; thixotropy after
Proske, Morgan and Gregory 1993; coupling by two-joint muscles after Hogan 1985.
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
from analysis.closeloop.session.signals import shifted

#: Rest that makes a muscle stiff again, s.
REST_SECONDS = 0.3


class StretchReflex(Effect):
    """Torque against a stretch beyond a speed or an angle, some time after it."""

    name = "stretch_reflex"
    complexity = 4
    signature = "the residual resists one direction only, beyond a speed or an angle, a little late"
    element = "applied torque"
    separating_trial = "stretch the joint through the same range at four speeds, and record the EMG"
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        grid: list[Theta] = []
        for side in (-1.0, 1.0):
            for delay in (0.0, 0.03, 0.06, 0.1):
                for speed in (0.0, 0.15, 0.35, 0.6):
                    grid.append({"side": side, "delay": delay, "speed": speed, "angle": -2.0})
                for angle in (-0.5, -0.2, 0.1, 0.4, 0.7):
                    grid.append({"side": side, "delay": delay, "speed": 0.0, "angle": angle})
        return grid

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        middle, half = travel(recording, joint)
        side, top = theta["side"], float(recording.top_speed[joint])
        stretch = np.maximum(0.0, side * recording.velocity[:, joint] - theta["speed"] * top)
        beyond = side * (recording.position[:, joint] - middle) > theta["angle"] * half
        torque = stretch * beyond
        if theta["delay"]:
            for piece in recording.slices:
                torque[piece] = shifted(torque[piece], -theta["delay"], recording.rate)
        return {joint: (side * torque)[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        near: list[Theta] = [
            {**theta, "delay": max(0.0, theta["delay"] + sign * 0.015 * scale)} for sign in (-1, 1)
        ]
        name, step = ("angle", 0.15) if theta["angle"] > -1.0 else ("speed", 0.1)
        near += [{**theta, name: theta[name] + sign * step * scale} for sign in (-1, 1)]
        return near

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        name = recording.device.joints[joint]
        unit, angle = recording.device.unit(name), recording.device.angle_unit(name)
        middle, half = travel(recording, joint)
        found = {
            "gain": Parameter(unit=f"{unit} s/{angle}", column=0),
            "delay": Parameter(unit="s", value=theta["delay"]),
            "side": Parameter(unit="1", value=theta["side"]),
            "threshold_velocity": Parameter(
                unit=f"{angle}/s", value=theta["speed"] * float(recording.top_speed[joint])
            ),
        }
        if theta["angle"] > -1.0:
            onset = middle + theta["side"] * theta["angle"] * half
            found["threshold_angle"] = Parameter(unit=angle, value=onset)
        return found


class Thixotropy(Effect):
    """Resistance that is high after a rest and is lost by moving."""

    name = "thixotropy"
    complexity = 2
    signature = "the first movement after a rest meets more resistance than the next ones"
    element = "applied torque"
    separating_trial = "rest ten seconds, then move to and fro five times without a pause"
    lower = (0.0,)

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"distance": share} for share in (0.2, 0.5, 1.0, 2.0)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        _, half = travel(recording, joint)
        way = distance_since_rest(recording, joint)
        sign = np.tanh(recording.velocity[:, joint] / recording.rest_speed[joint])
        return {joint: (sign * np.exp(-way / (theta["distance"] * half)))[:, None]}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "distance", scale)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        name = recording.device.joints[joint]
        _, half = travel(recording, joint)
        return {
            "torque": Parameter(unit=recording.device.unit(name), column=0),
            "distance": Parameter(
                unit=recording.device.angle_unit(name), value=theta["distance"] * half
            ),
        }


def distance_since_rest(recording: Recording, joint: int) -> np.ndarray:
    """Return the way moved since the last rest; a piece begins rested, (n,)."""
    way = np.zeros(len(recording.time))
    for piece in recording.slices:
        speed = np.abs(recording.velocity[piece, joint])
        path = np.cumsum(speed) / recording.rate
        still = speed < recording.rest_speed[joint]
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        base = np.zeros(len(speed))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if (stop - start) / recording.rate >= REST_SECONDS:
                base[start:] = path[stop - 1]
        way[piece] = np.maximum(path - base, 0.0)
    return way


class CrossJointCoupling(Effect):
    """Torque at one joint from the position and velocity of its neighbour."""

    name = "cross_joint_coupling"
    complexity = 2
    signature = "the residual of one joint follows the position of another"
    element = "applied torque"
    separating_trial = "move the neighbouring joint alone while this one is held"

    def applies(self, recording: Recording, joint: int) -> bool:
        return neighbour(recording, joint) is not None

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        other = neighbour(recording, joint)
        assert other is not None
        position = recording.position[:, other] - recording.position[:, other].mean()
        return {joint: np.column_stack([position, recording.velocity[:, other]])}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        name = recording.device.joints[joint]
        unit, angle = recording.device.unit(name), recording.device.angle_unit(name)
        other = neighbour(recording, joint)
        assert other is not None
        return {
            "stiffness": Parameter(unit=f"{unit}/{angle}", column=0),
            "damping": Parameter(unit=f"{unit} s/{angle}", column=1),
            "neutral": Parameter(unit=angle, value=float(recording.position[:, other].mean())),
            "other_dof": Parameter(unit="1", value=float(other)),
        }


def neighbour(recording: Recording, joint: int) -> int | None:
    """Return the joint before or after in the chain that is recorded moving, or None."""
    moving = np.ptp(recording.position, axis=0) > 5e-3
    others = [j for j in range(len(moving)) if j != joint and moving[j]]
    return min(others, key=lambda j: abs(j - joint)) if others else None
