"""What a model of the balance consists of: effects at joints, their columns, and what is given."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from analysis.closeloop.session.contents import HungLoad
from sim.effects.effect import Columns, Effect, Theta


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect at a joint."""

    effect: Effect
    joint: int

    @property
    def key(self) -> tuple[str, int]:
        return self.effect.name, self.joint

    def includes(self, other: "Candidate") -> bool:
        """Whether the other is a special case of this one."""
        return other.joint == self.joint and other.effect.name in self.effect.includes

    def replaces(self, other: "Candidate") -> bool:
        """Whether this one takes the place of the other, which is simpler."""
        simpler = (*self.effect.includes, *self.effect.grows_from)
        return other.joint == self.joint and other.effect.name in simpler


@dataclass(frozen=True, kw_only=True)
class Term:
    """A block of columns in the model: a declared effect, an added one, or none at all."""

    joint: int
    columns: Columns
    lower: tuple[float, ...] = (-np.inf,)
    theta: Theta = field(default_factory=dict)
    kept: tuple[int, ...] = ()
    effect: Effect | None = None
    #: What was added; None if declared.
    candidate: Candidate | None = None
    #: The declared load that it is, in the trials that name it.
    load: HungLoad | None = None

    @property
    def at(self) -> Candidate:
        """The effect and its joint; only of a term that has an effect."""
        assert self.effect is not None
        return Candidate(effect=self.effect, joint=self.joint)

    def bound(self, column: int) -> float:
        """Return the lower bound of a column's coefficient."""
        return self.lower[min(column, len(self.lower) - 1)]

    @property
    def width(self) -> int:
        """Columns before those go that others explain."""
        return int(next(iter(self.columns.values())).shape[1])

    @property
    def rubs(self) -> bool:
        """Whether the motion does not determine its torque at rest."""
        return self.effect is not None and self.effect.rubs


@dataclass(frozen=True, kw_only=True)
class Channel:
    """What the effort channel does to the torque that the joint feels."""

    candidate: Candidate
    theta: Theta

    @property
    def at(self) -> Candidate:
        """The effect and its joint."""
        return self.candidate


@dataclass(frozen=True, kw_only=True)
class Given:
    """What the model holds beside its terms, with values that no fit of the terms changes."""

    #: Torque that it takes, (n, 1) per joint.
    torque: Columns
    #: What brought it; None for the part of a whole that one joint sees.
    candidate: Candidate | None = None
    #: Inertial parameters of every link by its name, (10,); empty unless they are what is given.
    links: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: By how much links differ from the declared, by the number of the body, (10,) or (n, 10).
    changes: Mapping[int, np.ndarray] = field(default_factory=dict)


def kept_columns(term: Term) -> Columns:
    return {joint: columns[:, list(term.kept)] for joint, columns in term.columns.items()}
