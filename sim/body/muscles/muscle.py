"""What a muscle is: its force, its path over the bones, and what it shares with its group."""

from dataclasses import dataclass

#: A point of a muscle's path: bone and position in its frame, m.
Point = tuple[str, tuple[float, float, float]]
#: Length as a sum of three terms: per m of the upper arm's drawn scale, of the forearm's, and
#: constant (m).
Formula = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Wrap:
    """A cylinder along the elbow's axis, fixed to the humerus, that muscles pass on one side."""

    name: str
    centre: Point
    #: At the nominal wearer, m.
    radius: float
    #: The side they pass: along the humerus and across the elbow's axis, from the centre.
    side: tuple[float, float]
    #: Which part of the path it is in, from 0, between two points.
    part: int


@dataclass(frozen=True, kw_only=True)
class Fibres:
    """Published fibres and tendon of a muscle; the tendon is taken as rigid."""

    #: Optimal fibre length and tendon slack length, m.
    optimal: float
    slack: float
    #: Length of the published path, the elbow straight and the shoulder flexed to 90 degrees, m.
    extended: float


@dataclass(frozen=True, kw_only=True)
class Muscle:
    """One muscle-tendon unit."""

    name: str
    #: Peak active force before the group's scaling, N.
    force: float
    #: Path from origin to insertion, straight between points.
    path: tuple[Point, ...]
    #: Shortest and longest tendon length, m; None: swept from the elbow's motion.
    length_range: tuple[float, float] | None = None
    #: Both as published formulas instead.
    length_formulas: tuple[Formula, Formula] | None = None
    #: Optimal lengths at both; None: the group's.
    operating_range: tuple[float, float] | None = None
    #: What decides them instead, at the nominal wearer.
    fibres: Fibres | None = None
    wrap: Wrap | None = None


@dataclass(frozen=True, kw_only=True)
class MuscleGroup:
    """Muscles with what they have in common, MuJoCo's defaults; lengths in optimal ones."""

    muscles: tuple[Muscle, ...]
    #: What their peak forces are multiplied by.
    force_scale: float = 1.0
    #: Lengths at the two ends of the length range.
    operating_range: tuple[float, float] = (0.75, 1.05)
    #: Lengths at which active force vanishes.
    shortest_active: float = 0.5
    longest_active: float = 1.6
    #: MuJoCo's passive force over peak force (its `fpmax`).
    passive_force: float = 1.3


@dataclass(frozen=True, kw_only=True)
class ElbowMuscles:
    """One set of the muscles that move the elbow; its groups have the same muscles by name."""

    flexors: MuscleGroup
    extensors: MuscleGroup
