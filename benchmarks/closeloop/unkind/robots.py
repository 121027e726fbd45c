"""Devices of the bench, an elbow with a limb and serial arms: as declared, and as they are."""

from dataclasses import dataclass

import numpy as np

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
#: Ways in which industrial arms arrange their axes.
PATTERNS = ("zyyxyx", "zyyyzy", "yyzyzy", "zyxyxy", "yxyzyx")


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A hinge and the link that it turns."""

    name: str
    axis: tuple[float, ...]
    #: Where it sits in the frame of the link before it, m.
    at: tuple[float, ...]
    #: Of the link: kg, m, kg m^2 about its centre of mass.
    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]
    #: Of the drive, declared: kg m^2 and Nm s/rad.
    armature: float
    damping: float
    #: Range of motion, rad.
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Limb:
    """What a human limb does at a joint: -K (q - q0) - D qd."""

    joint: str
    stiffness: float
    damping: float
    neutral: float


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A serial arm; `limb` is None for a robot alone."""

    joints: tuple[Joint, ...]
    gravity: tuple[float, ...]
    limb: Limb | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its joints, from the base."""
        return tuple(joint.name for joint in self.joints)

    def index(self, name: str) -> int:
        """Place of a joint in the chain."""
        return self.names.index(name)


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """How the real device differs from the declared one in its build."""

    #: Joint to (stiffness Nm/rad, damping Nm s/rad) of a spring behind the motor.
    springs: dict[str, tuple[float, float]]
    #: Joint to the width of a gap behind the motor, rad.
    gaps: dict[str, float]
    #: Joint to a mass on its link: kg and m.
    loads: dict[str, tuple[float, tuple[float, ...]]]
    #: Joint to more inertia at its drive, kg m^2.
    inertias: dict[str, float]


def _row(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def declared_xml(robot: Robot) -> str:
    """Return the model that a session declares."""
    return _xml(robot, None, 0.002)


def real_xml(robot: Robot, hidden: Hidden, step: float) -> str:
    """Return the device as it is, for simulation with a time step in s.

    A joint NAME with a spring or a gap has a second hinge NAME_flex behind the motor.
    """
    return _xml(robot, hidden, step)


def _xml(robot: Robot, hidden: Hidden | None, step: float) -> str:
    lines, ends = [], []
    for joint in robot.joints:
        limits = (
            ""
            if hidden
            else f' limited="true" range="{joint.low - 0.6:.4f} {joint.high + 0.6:.4f}"'
        )
        more = hidden.inertias.get(joint.name, 0.0) if hidden else 0.0
        hinge = (
            f'<joint name="{joint.name}" axis="{_row(joint.axis)}" damping="{joint.damping:.6g}" '
            f'armature="{joint.armature + more:.6g}"{limits}/>'
        )
        lines.append(f'<body name="{joint.name}_link" pos="{_row(joint.at)}">{hinge}')
        ends.append("</body>")
        if hidden and joint.name in {**hidden.springs, **hidden.gaps}:
            lines.append('<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-8 1e-8 1e-8"/>')
            lines.append(f'<body name="{joint.name}_far">{_flex(joint, hidden)}')
            ends.append("</body>")
        lines.append(
            f'<inertial pos="{_row(joint.com)}" mass="{joint.mass:.6g}" '
            f'diaginertia="{_row(joint.inertia)}"/>'
        )
        if hidden and joint.name in hidden.loads:
            mass, place = hidden.loads[joint.name]
            size = 0.4 * mass * 0.03**2
            lines.append(
                f'<body name="{joint.name}_load" pos="{_row(place)}"><inertial pos="0 0 0" '
                f'mass="{mass:.9g}" diaginertia="{_row((size,) * 3)}"/></body>'
            )
    option = (
        f'<option timestep="{step}" gravity="{_row(robot.gravity)}" integrator="implicitfast"/>'
    )
    defaults = (
        '<default><joint type="hinge" solreffriction="0.004 1" '
        'solimpfriction="0.999 0.9999 0.001"/></default>'
        if hidden
        else ""
    )
    return (
        f'<mujoco model="device"><compiler angle="radian"/>{option}{defaults}<worldbody>'
        + "\n".join(lines)
        + "".join(ends)
        + "</worldbody></mujoco>\n"
    )


def _flex(joint: Joint, hidden: Hidden) -> str:
    head = f'<joint name="{joint.name}_flex" axis="{_row(joint.axis)}"'
    if joint.name in hidden.springs:
        stiffness, damping = hidden.springs[joint.name]
        return f'{head} stiffness="{stiffness:.9g}" damping="{damping:.6g}"/>'
    half = hidden.gaps[joint.name] / 2
    return (
        f'{head} damping="0.02" limited="true" range="{-half:.9g} {half:.9g}" '
        'solreflimit="0.004 1" solimplimit="0.99 0.999 0.0005"/>'
    )


def draw_elbow(rng: np.random.Generator, shoulder: bool) -> Robot:
    """Draw a device for one elbow, on a shoulder that holds or moves it if wanted."""
    mass, reach = rng.uniform(1.0, 3.5), rng.uniform(0.1, 0.25)
    thick = mass * rng.uniform(0.05, 0.12) ** 2
    low = rng.uniform(-0.1, 0.3)
    elbow = Joint(
        name="elbow",
        axis=AXES["y"],
        at=(0.3, 0.0, 0.0) if shoulder else (0.0, 0.0, 0.0),
        mass=mass,
        com=(reach, 0.0, float(rng.uniform(-0.02, 0.02))),
        inertia=(thick / 3, thick, thick),
        armature=float(rng.uniform(0.02, 0.12)),
        damping=float(rng.choice([0.0, rng.uniform(0.05, 0.4)])),
        low=low,
        high=low + rng.uniform(1.1, 1.9),
    )
    stiffness = float(np.exp(rng.uniform(np.log(1.0), np.log(12.0))))
    neutral = float(rng.uniform(elbow.low + 0.2, elbow.high - 0.2))
    limb = Limb(
        joint="elbow", stiffness=stiffness, damping=float(rng.uniform(0.05, 0.6)), neutral=neutral
    )
    tilt = 0.0 if shoulder else float(rng.choice([0.0, rng.uniform(0, 1.2), np.pi / 2]))
    gravity = (0.0, -9.81 * np.sin(tilt), -9.81 * np.cos(tilt))
    if not shoulder:
        return Robot(joints=(elbow,), gravity=gravity, limb=limb)
    upper = Joint(
        name="shoulder",
        axis=AXES["y"],
        at=(0.0, 0.0, 0.0),
        mass=3.0,
        com=(0.15, 0.0, 0.0),
        inertia=(0.01, 0.03, 0.03),
        armature=0.2,
        damping=0.5,
        low=-1.2,
        high=0.6,
    )
    return Robot(joints=(upper, elbow), gravity=gravity, limb=limb)


def draw_arm(rng: np.random.Generator, size: int) -> Robot:
    """Draw a serial arm of `size` joints, heavier at its base, as industrial arms are."""
    pattern = (
        str(rng.choice(PATTERNS))[6 - size :]
        if rng.random() < 0.5
        else str(rng.choice(PATTERNS))[:size]
    )
    mass, length = rng.uniform(3.0, 10.0), rng.uniform(0.2, 0.4)
    joints: list[Joint] = []
    for number, letter in enumerate(pattern):
        share = 0.62**number * rng.uniform(0.8, 1.2)
        own, long = mass * share, length * (0.8**number) * rng.uniform(0.8, 1.2)
        along = (0.0, 0.0, 1.0) if letter == "z" else (1.0, 0.0, 0.0)
        com = tuple(float(long * rng.uniform(0.3, 0.55) * a + rng.normal(0, 0.01)) for a in along)
        thick = own * 0.05**2
        slim, wide = 0.6 * thick, thick + own * long**2 / 14
        inertia = (wide, wide, slim) if letter == "z" else (slim, wide, wide)
        before = joints[-1].com if joints else (0.0, 0.0, 0.0)
        at = tuple(float(round(2.0 * value, 4)) for value in before)
        middle, half = rng.uniform(-0.6, 0.6), rng.uniform(0.8, 1.4)
        joints.append(
            Joint(
                name=f"joint_{number + 1}",
                axis=AXES[letter],
                at=at,
                mass=float(own),
                com=com,
                inertia=tuple(map(float, inertia)),
                armature=float(rng.uniform(0.3, 1.0) * own * 0.15**2 * 3),
                damping=0.0,
                low=float(middle - half),
                high=float(middle + half),
            )
        )
    return Robot(joints=tuple(joints), gravity=(0.0, 0.0, -9.81), limb=None)
