"""Between motor and limb: compliance, play, ripple, and friction that winds up before it slides.

Spong 1987 (elastic joints); Nordin and Gutman 2002 (backlash); Dahl 1968 (friction that depends on
the way since reversal); Pfeiffer and Holzl 1995 (ripple).
"""

import itertools
from collections.abc import Callable

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Effect, Law, Theta, scaled
from sim.effects.functions import Signal, cos, exp, sin
from sim.effects.motion import Estimate, Motion, Recording, travel
from sim.effects.parameter import Parameter, Reading, Step, Values, named, size


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
    parameters = named(compliance=Parameter(unit="rad/Nm", description="1 / k"))
    coefficients = ("compliance",)
    lower = (0.0,)
    uses_estimate = True

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: -_felt(recording, joint, estimate.prediction[:, joint], estimate)[:, None]}


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
    parameters = named(gap=Parameter(unit="rad", description="whole play"))
    lower = (0.0,)
    uses_estimate = True
    at_reversals = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [
            {"width": share, "late": late}
            for share in (0.02, 0.06, 0.15, 0.3)
            for late in (0.0, 0.03, 0.08, 0.16)
        ]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "width", scale)

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        load = estimate.prediction[:, joint]
        spread = max(float(np.quantile(np.abs(load), 0.95)), 1e-9)
        side = np.tanh(load / (theta["width"] * spread))
        if theta["late"]:
            side = recording.lagged(side, theta["late"])
        return {joint: -_felt(recording, joint, recording.smoothed(side), estimate)[:, None]}

    def readings(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Reading]:
        return {"gap": Reading(column=0, scale=2.0)}


class TorqueRipple(Law):
    """A torque that is periodic in position: cogging, gear teeth, commutation."""

    name = "torque_ripple"
    complexity = 3
    signature = "the residual is periodic in position, the same at every speed"
    separating_trial = "move slowly and evenly through the range, both ways"
    owner = "robot"
    parameters = named(
        cosine=size("Nm", 1.0, "ripple, cosine part", low=-1.0),
        sine=size("Nm", 1.0, "ripple, sine part", low=-1.0),
        order=Parameter(
            unit="1", low=1.0, high=40.0, neutral=12.0, description="periods a turn", choice=True
        ),
    )
    coefficients = ("cosine", "sine")
    steps = (Step("order"),)
    uses_estimate = True

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        angle = parameters["order"] * motion.position
        return parameters["cosine"] * cos(angle) + parameters["sine"] * sin(angle)

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

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "order", scale, step=0.01)

    def fixed(self, recording: Recording, joint: int, theta: Theta) -> Values:
        return {"order": theta["order"]}

    def unit(self, parameter: str, theta: Theta) -> str:
        return "1/rad" if parameter == "order" else super().unit(parameter, theta)


class Hysteresis(AppliedEffect):
    """Friction that builds up over a distance after each reversal (Dahl's model)."""

    name = "hysteresis"
    complexity = 2
    signature = "after each reversal the residual rises over the same distance, not the same time"
    separating_trial = "move to and fro with small and with large amplitudes at one speed"
    parameters = named(
        torque=Parameter(unit="Nm", description="once it slides"),
        distance=Parameter(unit="rad", description="over which it builds up"),
    )
    coefficients = ("torque",)
    lower = (0.0,)
    steps = (Step("distance"),)
    rubs = directed = at_reversals = True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"distance": share} for share in (0.03, 0.06, 0.12, 0.25, 0.5)]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "distance", scale)

    def fixed(self, recording: Recording, joint: int, theta: Theta) -> Values:
        return {"distance": theta["distance"] * travel(recording, joint)[1]}

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        """Return the friction state along the recorded motion; each piece starts at 0."""
        distance = self.fixed(recording, joint, theta)["distance"]
        state = np.zeros((len(recording.time), 1))
        for piece in recording.slices:
            position = recording.position[piece, joint]
            sign = np.sign(np.diff(position, prepend=position[0]))
            turns = np.flatnonzero(np.diff(sign)) + 1
            part, z = state[piece, 0], 0.0
            for start, stop in itertools.pairwise([0, *turns, len(position)]):
                way = np.abs(position[start:stop] - position[max(start - 1, 0)])
                part[start:stop] = self.wound(z, float(sign[start]), way, distance)
                z = part[stop - 1]
        return {joint: state}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        state = 0.0

        def torque(motion: Motion) -> float:
            nonlocal state
            speed = float(motion.velocity)
            sign = float((speed > 0) - (speed < 0))
            state = float(self.wound(state, sign, abs(speed) * step, parameters["distance"]))
            return parameters["torque"] * state

        return torque

    @staticmethod
    def wound(state: float, sign: float, way: Signal, distance: float) -> Signal:
        """Return the state, -1 to 1, after a way in one direction from `state`.

        The closed form of dz/dq = (1 - sign(v) z) / distance.
        """
        return sign + (state - sign) * exp(-way / distance) if sign else state


def _felt(recording: Recording, joint: int, ahead: np.ndarray, estimate: Estimate) -> np.ndarray:
    """Return the torque that a move by `ahead` (rad or m, (n,)) changes: M, D and K of it."""
    rate = recording.derivative(ahead)
    twice = recording.derivative(rate)
    # The slope of gravity and declared springs over the joint's own position.
    slope = estimate.stiffness[joint] + recording.secant(joint, 1e-4)[:, joint]
    inertia = recording.own_inertia[:, joint]
    return np.asarray(inertia * twice + estimate.damping[joint] * rate + slope * ahead)
