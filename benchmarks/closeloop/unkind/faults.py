"""What a declared model may lack: effects and what no catalogue has, drawn at unit size.

The names are those of the contract (docs/use/close_loop.md); the laws are the bench's own, in
`laws`. `size` scales the values named in `SCALED` until the effect is as strong as wanted.
"""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.closeloop.unkind.robots import Robot

FRICTION = (
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
)
#: At most one of each group is in a session (at one joint of an arm): no trial tells them apart.
GROUPS = (
    FRICTION,
    ("torque_gain", "payload", "added_inertia"),
    ("time_delay", "actuator_lag", "series_elasticity", "backlash"),
    (
        "nonlinear_stiffness",
        "end_range_torque",
        "hysteresis",
        "thixotropic_stiffness",
        "stress_relaxation",
    ),
    ("torque_offset", "drift"),
)
ELBOW = (
    *FRICTION,
    "torque_gain",
    "payload",
    "added_inertia",
    "position_offset",
    "nonlinear_stiffness",
    "end_range_torque",
    "torque_ripple",
    "time_delay",
    "actuator_lag",
    "series_elasticity",
    "backlash",
    "hysteresis",
    "stretch_reflex",
    "thixotropic_stiffness",
    "stress_relaxation",
    "drift",
    "cross_joint_coupling",
)
ARM = (
    "coulomb_friction",
    "viscous_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "torque_offset",
    "torque_gain",
    "payload",
    "added_inertia",
    "position_offset",
    "joint_stiffness",
    "torque_ripple",
    "time_delay",
    "actuator_lag",
    "series_elasticity",
    "backlash",
    "hysteresis",
    "drift",
    "cross_joint_coupling",
)
#: Torque that the catalogue has no name for.
OUTSIDE = ("tremor", "voluntary_torque", "strap_slip", "pump", "wandering_torque")
#: Values that grow with the size, by effect; all in SI units.
SCALED = {
    "coulomb_friction": ("torque",),
    "viscous_friction": ("damping",),
    "stribeck_friction": ("coulomb", "static"),
    "asymmetric_friction": ("plus", "minus", "viscous_plus", "viscous_minus"),
    "load_dependent_friction": ("base", "slope"),
    "position_dependent_friction": ("mean",),
    "torque_offset": ("torque",),
    "torque_gain": ("excess",),
    "payload": ("mass",),
    "added_inertia": ("inertia",),
    "position_offset": ("angle",),
    "joint_stiffness": ("stiffness",),
    "nonlinear_stiffness": ("cubic",),
    "end_range_torque": ("torque",),
    "torque_ripple": ("torque",),
    "time_delay": ("seconds",),
    "actuator_lag": ("seconds",),
    "series_elasticity": ("compliance",),
    "backlash": ("gap",),
    "hysteresis": ("torque",),
    "stretch_reflex": ("gain",),
    "thixotropic_stiffness": ("stiffness",),
    "stress_relaxation": ("stiffness",),
    "drift": ("torque",),
    "cross_joint_coupling": ("stiffness",),
    "tremor": ("torque",),
    "voluntary_torque": ("torque",),
    "strap_slip": ("torque",),
    "pump": ("torque",),
    "wandering_torque": ("torque",),
}
#: Sizes that a device may have; the sign is drawn with the shape.
RANGES = {
    "torque_gain": (0.02, 0.3),
    "position_offset": (0.01, 0.35),
    "time_delay": (0.003, 0.06),
    "actuator_lag": (0.003, 0.06),
    "series_elasticity": (0.0008, 0.04),
    "backlash": (0.003, 0.12),
}


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that the declared model lacks, at unit size."""

    name: str
    joint: str
    values: dict[str, float]
    #: Another joint (`cross_joint_coupling`).
    other: str = ""
    #: Where a `payload` hangs in the frame of the joint's link, m.
    place: tuple[float, ...] = ()
    #: Wanted strength: RMS of what only it explains over RMS of the effort's noise.
    ratio: float = 5.0
    size: float = field(default=1.0)

    def value(self, key: str) -> float:
        """Return a value at the fault's size."""
        return self.values[key] * (self.size if key in SCALED[self.name] else 1.0)


def sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def draw_fault(name: str, joint: str, robot: Robot, rng: np.random.Generator) -> Fault:
    """Draw the shape of a fault at a joint, and how strong it is to be."""
    here = robot.joints[robot.index(joint)]
    low, high = here.low, here.high
    middle = float(rng.uniform(low + 0.3 * (high - low), high - 0.3 * (high - low)))
    u = rng.uniform
    values: dict[str, float] = {
        "coulomb_friction": lambda: {"torque": 1.0},
        "viscous_friction": lambda: {"damping": 1.0},
        "stribeck_friction": lambda: {
            "coulomb": 1.0,
            "static": u(1.7, 3.0),
            "velocity": u(0.04, 0.25),
        },
        "asymmetric_friction": lambda: {
            "plus": 1.0,
            "minus": u(0.3, 0.7),
            "viscous_plus": u(0.0, 0.3),
            "viscous_minus": u(0.5, 1.2),
        },
        "load_dependent_friction": lambda: {"base": u(0.0, 0.5), "slope": u(0.1, 0.4)},
        "position_dependent_friction": lambda: {
            "mean": 1.0,
            "depth": u(0.5, 0.95),
            "waves": u(1.5, 5.0),
            "phase": u(0, 2 * np.pi),
        },
        "torque_offset": lambda: {"torque": sign(rng)},
        "torque_gain": lambda: {"excess": sign(rng)},
        "payload": lambda: {"mass": 1.0},
        "added_inertia": lambda: {"inertia": 1.0},
        "position_offset": lambda: {"angle": sign(rng)},
        "joint_stiffness": lambda: {"stiffness": 1.0, "neutral": middle},
        "nonlinear_stiffness": lambda: {"cubic": 1.0},
        "end_range_torque": lambda: {
            "torque": 1.0,
            "onset": u(0.35, 0.6),
            "width": u(0.05, 0.15),
            "side": sign(rng),
        },
        "torque_ripple": lambda: {"torque": 1.0, "waves": u(8, 30), "phase": u(0, 2 * np.pi)},
        "time_delay": lambda: {"seconds": 1.0},
        "actuator_lag": lambda: {"seconds": 1.0},
        "series_elasticity": lambda: {"compliance": 1.0, "ratio": u(0.05, 0.3)},
        "backlash": lambda: {"gap": 1.0},
        "hysteresis": lambda: {"torque": 1.0, "distance": u(0.08, 0.3)},
        "stretch_reflex": lambda: {
            "gain": 1.0,
            "threshold": u(0.3, 0.7),
            "delay": u(0.03, 0.07),
            "side": sign(rng),
        },
        "thixotropic_stiffness": lambda: {
            "stiffness": 1.0,
            "recovery": u(0.8, 3.0),
            "distance": u(0.1, 0.4),
        },
        "stress_relaxation": lambda: {"stiffness": 1.0, "seconds": u(0.2, 3.0)},
        "drift": lambda: {"torque": sign(rng), "bend": float(rng.choice([0.0, u(1.0, 3.0)]))},
        "cross_joint_coupling": lambda: {"stiffness": sign(rng), "neutral": 0.0},
        "tremor": lambda: {"torque": 1.0, "hertz": u(3.5, 9.0), "wobble": u(0.3, 1.0)},
        "voluntary_torque": lambda: {"torque": 1.0, "hertz": u(0.3, 1.2)},
        "strap_slip": lambda: {"torque": 1.0, "every": u(1.5, 4.0)},
        "pump": lambda: {"torque": 1.0, "hertz": u(6.0, 20.0)},
        "wandering_torque": lambda: {"torque": 1.0, "hertz": u(0.05, 0.2)},
    }[name]()
    others = [other for other in robot.names if other != joint]
    reach = 2.0 * np.array(here.com) if robot.limb is None else np.array([2 * here.com[0], 0, 0])
    place = reach * u(0.4, 1.1) + rng.normal(0, 0.02 if robot.limb is None else 0.003, 3)
    return Fault(
        name=name,
        joint=joint,
        values={key: float(value) for key, value in values.items()},
        other=str(rng.choice(others)) if others and name == "cross_joint_coupling" else "",
        place=tuple(map(float, place)) if name == "payload" else (),
        ratio=float(np.exp(u(np.log(3.5), np.log(20.0)))),
    )
