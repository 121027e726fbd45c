"""How faults act in the simulation: the bench's own laws, one joint and one time step at a time.

Dry friction is a level that may change with speed, load, angle and direction. MuJoCo's solver holds
the joint at it (rigid friction), or bristles do (Canudas de Wit et al. 1995, IEEE TAC 40(3),
419-425), exactly integrated over a step of constant speed.
"""

from collections import deque
from math import cos, exp, pi, sin, tanh

import numpy as np

from benchmarks.closeloop.unkind.chain import Signal
from benchmarks.closeloop.unkind.faults import FRICTION, Fault
from benchmarks.closeloop.unkind.robots import Limb

#: Widths over which the torque at an end of range is an exponential.
STEEPEST = 6.0


def friction_level(fault: Fault, q: float, v: float, load: float) -> float:
    """Return the torque that dry friction can hold or takes while sliding, Nm."""
    value = fault.value
    match fault.name:
        case "stribeck_friction":
            extra = value("static") - value("coulomb")
            return value("coulomb") + extra * exp(-((v / value("velocity")) ** 2))
        case "asymmetric_friction":
            return value("plus") if v > 0 else value("minus")
        case "load_dependent_friction":
            return value("base") + value("slope") * abs(load)
        case "position_dependent_friction":
            return value("mean") * (1 + value("depth") * sin(value("waves") * q + value("phase")))
    return value("torque")


class Bristles:
    """Friction with some millirads of presliding."""

    def __init__(self, distance: float) -> None:
        self.distance = distance
        self.bend = 0.0

    def torque(self, level: float, v: float, step: float) -> float:
        """Return the torque on the joint over the coming step."""
        self.bend = self.bend + v * step if abs(v) < 1e-9 else self._settled(v, step)
        return -level * max(-1.0, min(1.0, self.bend / self.distance))

    def _settled(self, v: float, step: float) -> float:
        end = self.distance if v > 0 else -self.distance
        return end + (self.bend - end) * exp(-abs(v) * step / self.distance)


class Law:
    """Torque of one fault on its joint, Nm; keeps what it remembers between steps."""

    def __init__(
        self,
        fault: Fault,
        limits: tuple[float, float],
        limb: Limb | None,
        start: float,
        duration: float,
        step: float,
        rng: np.random.Generator,
    ) -> None:
        """Begin a trial at `start` s of a session of `duration` s."""
        self.fault, self.limits, self.limb, self.step = fault, limits, limb, step
        self.start, self.duration = start, max(duration, 1.0)
        self.state = 1.0 if fault.name == "thixotropic_stiffness" else 0.0
        delay = fault.values.get("delay", 0.0)
        self.relaxed: float | None = None
        self.past: deque[float] = deque([0.0] * max(1, round(delay / step)))
        self.bristles = Bristles(fault.values.get("distance", 1.0))
        self.table = _outside(fault, rng, step)

    def torque(self, k: int, q: float, v: float, others: float) -> float:
        """Return the torque at step k, at an angle and speed; `others` is another joint's angle."""
        fault, value = self.fault, self.fault.value
        if self.table is not None:
            return float(value("torque") * self.table[k])
        match fault.name:
            case "viscous_friction":
                return -value("damping") * v
            case "asymmetric_friction":
                return -value("viscous_plus" if v > 0 else "viscous_minus") * v
            case "torque_offset":
                return value("torque")
            case "joint_stiffness":
                return -value("stiffness") * (q - value("neutral"))
            case "nonlinear_stiffness":
                assert self.limb is not None
                return -value("cubic") * (q - self.limb.neutral) ** 3
            case "end_range_torque":
                return self._end_range(q)
            case "torque_ripple":
                return value("torque") * sin(value("waves") * q + value("phase"))
            case "hysteresis":
                return self.bristles.torque(value("torque"), v, self.step)
            case "stretch_reflex":
                self.past.append(v * value("side"))
                late = self.past.popleft()
                return -value("side") * value("gain") * max(0.0, late - value("threshold"))
            case "thixotropic_stiffness":
                return self._thixotropy(q, v)
            case "stress_relaxation":
                return self._relaxation(q)
            case "drift":
                x = (self.start + k * self.step) / self.duration
                bend = value("bend")
                return value("torque") * (
                    x if bend == 0 else (1 - exp(-bend * x)) / (1 - exp(-bend))
                )
            case "cross_joint_coupling":
                return -value("stiffness") * (others - value("neutral"))
        return 0.0

    def _end_range(self, q: float) -> float:
        low, high = self.limits
        share = (q - low) / (high - low)
        side, onset, width = (self.fault.value(key) for key in ("side", "onset", "width"))
        far = (share if side > 0 else 1 - share) - onset
        if far <= 0:
            return 0.0
        # Beyond a few widths it goes on evenly: a torque that no longer rose would be no end.
        steep = min(far / width, STEEPEST)
        rise = exp(steep) * (1.0 + far / width - steep) - 1.0
        return -side * self.fault.value("torque") * rise

    def _relaxation(self, q: float) -> float:
        """A spring that hangs on a dashpot (Fung 1993)."""
        self.relaxed = q if self.relaxed is None else self.relaxed
        torque = -self.fault.value("stiffness") * (q - self.relaxed)
        self.relaxed += self.step * (q - self.relaxed) / self.fault.value("seconds")
        return torque

    def _thixotropy(self, q: float, v: float) -> float:
        """Stiffness that rest builds up and movement takes away (Lakie and Robson 1988).

        The product's `thixotropy` is friction after a rest, another law (Proske et al. 1993).
        """
        assert self.limb is not None
        recovery, distance = self.fault.value("recovery"), self.fault.value("distance")
        self.state += self.step * ((1 - self.state) / recovery - self.state * abs(v) / distance)
        return -self.fault.value("stiffness") * self.state * (q - self.limb.neutral)


def _outside(fault: Fault, rng: np.random.Generator, step: float) -> Signal | None:
    """Return 40 s of a torque that depends on time alone, RMS about 1."""
    count = round(40.0 / step)
    time = np.arange(count) * step
    match fault.name:
        case "tremor":
            hertz = fault.value("hertz")
            wander = np.cumsum(rng.normal(0, fault.value("wobble") * np.sqrt(step), count))
            slow = 1 + 0.4 * np.sin(2 * pi * 0.3 * time + rng.uniform(0, 2 * pi))
            return np.asarray(np.sqrt(2) * slow * np.sin(2 * pi * hertz * time + wander))
        case "pump":
            phase = rng.uniform(0, 2 * pi)
            return np.asarray(np.sqrt(2) * np.sin(2 * pi * fault.value("hertz") * time + phase))
        case "voluntary_torque" | "wandering_torque":
            sines = np.zeros(count)
            for _ in range(24):
                hertz = fault.value("hertz") * rng.uniform(0.3, 1.5)
                sines += np.sin(2 * pi * hertz * time + rng.uniform(0, 2 * pi))
            return np.asarray(sines / np.sqrt(12))
        case "strap_slip":
            jumps = np.cumsum(rng.exponential(fault.value("every"), 200))
            levels = rng.normal(0, 1, 201)
            return np.asarray(levels[np.searchsorted(jumps, time)])
    return None


def is_friction(fault: Fault) -> bool:
    """Say whether a fault is dry friction, which has a level."""
    return fault.name in FRICTION


def bump(x: float) -> float:
    """Return the shape of a push: 0 to 1 and back for x from 0 to 1."""
    return 0.0 if not 0 < x < 1 else min(1.0, 1.6 * (1 - cos(2 * pi * x)) / 2) * tanh(20 * x)
