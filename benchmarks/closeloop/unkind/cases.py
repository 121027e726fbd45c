"""A session of the bench as a value: drawn from a seed, changed by the search, kept as JSON."""

from dataclasses import asdict, dataclass
from typing import Any
from zlib import crc32

import numpy as np
from pydantic import TypeAdapter

from benchmarks.closeloop.unkind.chain import Chain, draw_chain
from benchmarks.closeloop.unkind.faults import (
    ARM,
    ELBOW,
    FRICTION,
    GROUPS,
    OUTSIDE,
    Fault,
    draw_fault,
)
from benchmarks.closeloop.unkind.robots import Robot, draw_arm, draw_elbow

#: Seeds that anybody may look at while working, and seeds that are looked at for a report only.
SEEDS = {"tuning": 0, "reporting": 1_000_000}
#: Kinds of sessions in the order in which they take turns, by what they are about.
TURNS = {
    "limb": (
        "clean", "one", "clean", "one", "two", "clean", "one", "outside", "clean", "push",
        "clean", "one", "clean", "one", "two", "clean", "one", "outside", "three", "push",
    ),
    "arm": (
        "clean", "one", "two", "push", "three", "one", "two", "clean", "four", "push",
    ),
}  # fmt: skip
FIT = ("multisine", "ramp", "trapezoid", "stretch", "minimum_jerk", "multisine")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """One trial: what the controller is asked for, for how long (s), how fast (rad/s)."""

    number: int
    motion: str
    pace: float
    seconds: float
    #: Rests before it, s on the session's clock.
    pause: float
    #: What the shoulder of an elbow's device does meanwhile, rad: holds, or sways about, an angle.
    posture: float
    sway: float
    holdout: bool = False


@dataclass(frozen=True, kw_only=True)
class Controller:
    """`pd`, `pid`, `pd_gravity` or `computed_torque`, with its bandwidth."""

    kind: str
    hertz: float


@dataclass(frozen=True, kw_only=True)
class Push:
    """A person pushes: in which trial, when and how long (s), how hard beside the noise."""

    trial: int
    joint: str
    start: float
    seconds: float
    ratio: float


@dataclass(frozen=True, kw_only=True)
class Case:
    """All that a session depends on."""

    seeds: str
    world: str
    number: int
    kind: str
    robot: Robot
    faults: tuple[Fault, ...]
    pushes: tuple[Push, ...]
    #: Joint to Coulomb (Nm) and viscous (Nm s/rad) friction that the session declares as unknown.
    declared: dict[str, tuple[float, float]]
    plans: tuple[Plan, ...]
    controller: Controller
    chain: Chain
    #: Distance over which friction gives way before it slides, rad; 0 for MuJoCo's own.
    presliding: float

    @property
    def name(self) -> str:
        """What finds this session again: `--case NAME`."""
        return f"{self.seeds}:{self.world}:{self.number}"

    def rng(self, purpose: str, index: int = 0) -> np.random.Generator:
        """Return the random numbers for one purpose, the same however the case is changed."""
        return _rng(self.seeds, self.world, self.number, purpose, index)


def _rng(seeds: str, world: str, number: int, purpose: str, index: int) -> np.random.Generator:
    words = (SEEDS[seeds] + number, crc32(world.encode()), crc32(purpose.encode()), index)
    return np.random.default_rng(words)


def named(name: str) -> Case:
    """Return the case of a name as `tuning:limb:17`.

    Raises:
        ValueError: there is no such case.
    """
    try:
        seeds, world, number = name.split(":")
        return draw(seeds, world, int(number))
    except (KeyError, ValueError):
        known = " or ".join(SEEDS), " or ".join(TURNS)
        raise ValueError(f"{name} is no case: {known[0]}, then {known[1]}, then a number") from None


def draw(seeds: str, world: str, number: int, kind: str | None = None) -> Case:
    """Draw a session: `world` is `limb` or `arm`; the number says its kind, unless one is given."""
    kind = kind or TURNS[world][number % len(TURNS[world])]
    rng = _rng(seeds, world, number, "case", 0)
    wanted = {"one": 1, "outside": 1, "two": 2, "three": 3, "four": 4}.get(kind, 0)
    if world == "limb":
        names = _choose(rng, OUTSIDE if kind == "outside" else ELBOW, wanted)
        robot = draw_elbow(rng, "cross_joint_coupling" in names or rng.random() < 0.6)
        faults = [draw_fault(name, "elbow", robot, rng) for name in names]
        declared = {}
    else:
        robot = draw_arm(rng, int(rng.integers(2, 7)))
        faults = _arm_faults(rng, robot, wanted)
        declared = _declared(rng, robot, faults)
    plans = _plans(rng, world, kind)
    return Case(
        seeds=seeds,
        world=world,
        number=number,
        kind=kind,
        robot=robot,
        faults=tuple(faults),
        pushes=_pushes(rng, robot, plans) if kind == "push" else (),
        declared=declared,
        plans=plans,
        controller=Controller(
            kind=str(rng.choice(["pd", "pid", "pd_gravity", "computed_torque"])),
            hertz=float(rng.uniform(2.0, 6.0)),
        ),
        chain=draw_chain(rng),
        presliding=float(rng.choice([0.0, rng.uniform(0.001, 0.004)])),
    )


def _choose(rng: np.random.Generator, names: tuple[str, ...], count: int) -> list[str]:
    """Draw names of which no two are in one group."""
    chosen: list[str] = []
    for name in rng.permutation(names):
        group = next((group for group in GROUPS if name in group), (str(name),))
        if len(chosen) < count and not set(group) & set(chosen):
            chosen.append(str(name))
    return chosen


def _arm_faults(rng: np.random.Generator, robot: Robot, count: int) -> list[Fault]:
    """Draw faults at random joints; a payload hangs at the last link, one friction per joint."""
    faults: list[Fault] = []
    while len(faults) < count:
        name = str(rng.choice(ARM))
        joint = robot.names[-1] if name == "payload" else str(rng.choice(robot.names))
        here = [fault.name for fault in faults if fault.joint == joint]
        group = next((group for group in GROUPS if name in group), (name,))
        if set(group) & set(here) or (name == "payload" and "payload" in here):
            continue
        faults.append(draw_fault(name, joint, robot, rng))
    return faults


def _declared(
    rng: np.random.Generator, robot: Robot, faults: list[Fault]
) -> dict[str, tuple[float, float]]:
    """Friction that the user knows to be there, at every joint or (half of the arms) at none."""
    if rng.random() < 0.5:
        return {}
    taken = {fault.joint for fault in faults if fault.name in (*FRICTION, "viscous_friction")}
    found = {}
    for joint in robot.joints:
        size = joint.mass * 9.81 * max(0.05, float(np.linalg.norm(joint.com)))
        level, slope = size * rng.uniform(0.05, 0.2), size * rng.uniform(0.02, 0.1)
        if joint.name not in taken:
            found[joint.name] = (float(level), float(slope))
    return found


def _plans(rng: np.random.Generator, world: str, kind: str) -> tuple[Plan, ...]:
    motions = [*FIT, str(rng.choice(["multisine", "trapezoid", "minimum_jerk"]))]
    paces = [rng.uniform(0.4, 0.8), 0.6, *rng.uniform(0.6, 2.0, 4), rng.uniform(0.7, 1.6)]
    paces[5] = float(rng.uniform(1.0, 2.2))
    if kind == "push" and rng.random() < 0.5:
        motions, paces = ["still"] * 4, [1.0] * 4
    postures = rng.uniform(-1.0, 0.4, 2)
    last = len(motions) - 1
    return tuple(
        Plan(
            number=n,
            motion=motion,
            pace=float(paces[n]),
            seconds=float(rng.uniform(4.5, 6.0)) * (1.3 if motion in ("ramp", "stretch") else 1.0),
            pause=float(rng.uniform(0.5, 8.0)),
            posture=float(postures[n % 2]),
            sway=float(rng.choice([0.0, 0.3])) if world == "limb" and n % 3 != 1 else 0.0,
            holdout=n == last,
        )
        for n, motion in enumerate(motions)
    )


def _pushes(rng: np.random.Generator, robot: Robot, plans: tuple[Plan, ...]) -> tuple[Push, ...]:
    joints = [robot.limb.joint] if robot.limb else list(robot.names)
    trials = rng.permutation(len(plans) - 1)[: int(rng.integers(1, 3))]
    return tuple(
        Push(
            trial=int(trial),
            joint=str(rng.choice(joints)),
            start=float(rng.uniform(0.8, plans[trial].seconds - 2.0)),
            seconds=float(rng.uniform(0.25, 1.0)),
            ratio=float(np.exp(rng.uniform(np.log(4.0), np.log(15.0)))),
        )
        for trial in sorted(trials)
    )


def to_json(case: Case) -> dict[str, Any]:
    """Return a case as JSON can hold it."""
    return asdict(case)


def from_json(content: object) -> Case:
    """Return the case that `to_json` wrote."""
    return TypeAdapter(Case).validate_python(content)
