"""What a muscle is: its force, its path over the bones, and what it shares with its group."""

from dataclasses import dataclass

#: A point of a muscle's path: bone and position in its frame, m.
Point = tuple[str, tuple[float, float, float]]


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
    #: Optimal lengths at both; None: the group's.
    operating_range: tuple[float, float] | None = None
    #: Whether the last part of the path wraps round the trochlea.
    wraps: bool = False


#: MuJoCo's defaults: operating range, shortest active length, passive force.
DEFAULT_RANGE, DEFAULT_SHORTEST_ACTIVE, DEFAULT_PASSIVE_FORCE = (0.75, 1.05), 0.5, 1.3


@dataclass(frozen=True, kw_only=True)
class MuscleGroup:
    """Muscles with what they have in common; lengths in optimal ones."""

    muscles: tuple[Muscle, ...]
    #: What their peak forces are multiplied by.
    force_scale: float = 1.0
    #: Lengths at the two ends of the length range.
    operating_range: tuple[float, float] = DEFAULT_RANGE
    #: Length at which active force vanishes.
    shortest_active: float = DEFAULT_SHORTEST_ACTIVE
    #: Passive force at 1.6 optimal lengths, over peak force.
    passive_force: float = DEFAULT_PASSIVE_FORCE


@dataclass(frozen=True, kw_only=True)
class ElbowMuscles:
    """One fit of the muscles that move the elbow; its groups have the same muscles by name."""

    flexors: MuscleGroup
    extensors: MuscleGroup
