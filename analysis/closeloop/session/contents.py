"""What a session consists of: the device's name, the trials, and what the user declares."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco

#: What a session calls the project's own nominal arm in the exoskeleton.
NOMINAL = "nominal"


@dataclass(frozen=True, kw_only=True)
class DeclaredEffect:
    """An effect the user accounts for and whose values are unknown: fitted before and after."""

    effect: str
    joint: str


@dataclass(frozen=True, kw_only=True)
class AddedMass:
    """A known load that one trial carried."""

    body: str
    mass: float
    #: In the body's frame, m.
    position: tuple[float, float, float]
    #: About every axis through its centre, kg m2.
    inertia: float = 0.0

    def hang(self, spec: "mujoco.MjSpec") -> None:
        """Hang the mass on its body of `spec`."""
        body = spec.body(self.body).add_body(pos=list(self.position))
        body.explicitinertial = True
        body.mass = self.mass
        # Without it MuJoCo takes the body's own position for its centre of mass, and doubles the
        # lever.
        body.ipos = [0.0, 0.0, 0.0]
        # MuJoCo wants a positive inertia; the least is a sphere's of a millimetre.
        body.inertia = [max(self.inertia, 1e-12, 4e-7 * self.mass)] * 3


@dataclass(frozen=True, kw_only=True)
class HungLoad:
    """A load of unknown mass that hangs on a body during a trial; one name is one load."""

    name: str
    body: str
    #: Of what is left of its trials without it the part that it takes, if no trial named it but it
    #: seems to hang there.
    supposed: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a foreign log holds one signal, and what makes it SI."""

    #: A name of the header, or the number of a line or column, counted from 1.
    signal: str | int
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """How to read a foreign log."""

    #: "columns": one sample a line under a header; "rows": one signal a line, no header.
    layout: str
    separator: str
    #: Clock of a log that has none, Hz.
    rate_hz: float | None
    sources: Mapping[str, Source]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One recording. Columns are float arrays of one length, under the names of the header."""

    file: str
    label: str
    group: str
    #: "fit" or "holdout".
    role: str
    added_mass: AddedMass | None = None
    payload: HungLoad | None = None
    #: Known low-pass of the effort channel, Hz.
    effort_filter_hz: float | None = None
    #: How to read a file that does not have the contract's own columns.
    source: ColumnMap | None = None
    #: The part of the file that is the trial, s on its clock; both ends belong to it.
    span: tuple[float, float] = (-inf, inf)
    #: What was left out when the file was read, in sentences.
    repairs: tuple[str, ...] = ()
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: Of each sample the line in the file, from 1, (n,); empty where none are known.
    lines: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    @property
    def part(self) -> str:
        """What part of its file the trial is, for a sentence; empty if it is all of it."""
        low, high = self.span
        begin = f" from {low:g} s" if low > -inf else ""
        return begin + (f" to {high:g} s" if high < inf else "")


@dataclass(frozen=True, kw_only=True)
class Session:
    """What `session.json` says; the trials hold their signals once they are read."""

    folder: Path
    model: str
    height_m: float = 1.75
    mass_kg: float = 70.0
    #: Along the axes of the model's world, m/s2; None leaves it to the model's file.
    gravity: tuple[float, float, float] | None = None
    declared: tuple[DeclaredEffect, ...] = ()
    ignored_joints: tuple[str, ...] = ()
    #: Joints at which a human limb acts.
    limb_joints: tuple[str, ...] = ()
    #: Cutoff of the positions' low-pass, Hz; None leaves it to the data.
    kinematic_cutoff_hz: float | None = None
    #: Root mean square of the noise of channels that the user knows, by `JOINT.effort`.
    noise: Mapping[str, float] = field(default_factory=dict)
    #: Those of which the user knows that they are the torque itself, not a share of it.
    calibrated: frozenset[str] = frozenset()
    trials: tuple[Trial, ...] = ()
    #: Keys of `session.json` that mean nothing here.
    unknown: tuple[str, ...] = ()
