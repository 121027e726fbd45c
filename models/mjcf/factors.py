"""Factors of an `mjcf` model: numbers of named elements that are set or scaled, then compiled."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import mujoco
import numpy as np

from intake.xml import listed
from models.folder import ModelError, ModelFolder
from models.mjcf.compiling import compiled

#: What a path may begin with: MjSpec finds each by its name in a method that is called so.
ELEMENTS = ("body", "joint", "geom", "site", "tendon", "actuator", "sensor", "equality")
#: Attributes of a body that MuJoCo infers from its geoms unless the file states them.
_INERTIAL = ("mass", "inertia", "ipos", "iquat", "fullinertia")
#: Angles of a hinge, which a file may state in degrees.
_ANGLES = ("range", "ref", "springref")
_PATH = re.compile(
    r"(?P<element>[a-z]+)\.(?:(?P<name>.+)\.)?(?P<attribute>[a-z_]+)(\[(?P<index>\d{1,6})\])?"
)
#: Enough for a whole robot; far beyond, a study would be about nothing.
MAX_PATHS = 10_000


@dataclass(frozen=True, kw_only=True)
class Change:
    """What one value of a factor does to one attribute."""

    factor: str
    #: As the file says it, for errors.
    path: str
    target: Any
    attribute: str
    #: The entries that change; None for an attribute that is a single number.
    entries: slice | None
    #: What is multiplied; None: the value replaces it.
    own: Any
    #: From radians to what the file states.
    unit: float

    def apply(self, value: float) -> None:
        """Set or scale the attribute."""
        new = value * self.unit if self.own is None else value * self.own
        if self.entries is None:
            setattr(self.target, self.attribute, new)
        else:
            getattr(self.target, self.attribute)[self.entries] = new


def changes(folder: ModelFolder, spec: mujoco.MjSpec) -> tuple[Change, ...]:
    """Return what the factors change in `spec`.

    A body whose mass or inertia is a factor gets the inertia that MuJoCo inferred from its geoms
    as its own, so that there is something to change.

    Raises:
        ModelError: a factor changes nothing, or a path leads to nothing that is a number.
    """
    found = []
    for i, factor in enumerate(folder.description.factors):
        said = folder.mjcf[factor.name]
        if not said:
            raise ModelError(f"factors[{i}] {factor.name} must say what it `sets` or `scales`")
        for word, paths in said.items():
            where = f"factors[{i}].{word}"
            if (
                not isinstance(paths, list)
                or not paths
                or not all(isinstance(path, str) for path in paths)
            ):
                raise ModelError(f"{where} must be a list of texts like 'joint.hinge.stiffness'")
            for path in paths:
                found.append(_change(spec, factor.name, path, word == "scales", where))
    if len(found) > MAX_PATHS:
        raise ModelError(f"factors change {len(found)} attributes; at most {MAX_PATHS}")
    _check_overlap(found)
    return tuple(found)


def _change(spec: mujoco.MjSpec, factor: str, path: str, scales: bool, where: str) -> Change:
    match = _PATH.fullmatch(path)
    if match is None:
        raise ModelError(
            f"{where}: {path[:80]!r} must be ELEMENT.NAME.ATTRIBUTE or "
            "ELEMENT.NAME.ATTRIBUTE[INDEX], as 'joint.hinge.stiffness'"
        )
    element, name, attribute = match["element"], match["name"], match["attribute"]
    target = _element(spec, element, name, f"{where}: {path[:80]!r}")
    value = _number(target, attribute, f"{where}: {path[:80]!r}")
    if element == "body" and attribute in _INERTIAL:
        _own_inertia(spec, target)
        value = getattr(target, attribute)
    unit = 1.0
    if element == "joint" and attribute in _ANGLES and spec.compiler.degree and _turns(target):
        unit = 180.0 / pi
    entries: slice | None = None
    if np.ndim(value):
        index = int(match["index"] or 0)
        if index >= len(value):
            raise ModelError(
                f"{where}: {path[:80]!r}: {attribute} has the entries 0 to {len(value) - 1}"
            )
        one = match["index"] is not None or not scales
        entries = slice(index, index + 1) if one else slice(0, len(value))
    elif match["index"] is not None:
        raise ModelError(f"{where}: {path[:80]!r}: {attribute} is one number, without an index")
    own = None
    if scales:
        own = np.array(value[entries]) if entries is not None else float(value)
        if not np.isfinite(own).all():
            raise ModelError(f"{where}: {path[:80]!r} is not in the file, so nothing can be scaled")
    return Change(
        factor=factor,
        path=path,
        target=target,
        attribute=attribute,
        entries=entries,
        own=own,
        unit=unit,
    )


def _element(spec: mujoco.MjSpec, element: str, name: str | None, where: str) -> Any:
    if element == "option":
        if name is not None:
            raise ModelError(f"{where}: option has no name: write 'option.ATTRIBUTE'")
        return spec.option
    if element not in ELEMENTS:
        raise ModelError(f"{where}: expected one of {', '.join((*ELEMENTS, 'option'))}")
    if name is None:
        raise ModelError(f"{where}: must name a {element}, as '{element}.NAME.ATTRIBUTE'")
    target = getattr(spec, element)(name)
    if target is None:
        there = listed(e.name for e in _every(spec, element))
        raise ModelError(f"{where}: there is no {element} {name[:60]!r}; the file has {there}")
    return target


def _every(spec: mujoco.MjSpec, element: str) -> Sequence[Any]:
    plural = {"body": "bodies", "equality": "equalities"}.get(element, f"{element}s")
    every: Sequence[Any] = getattr(spec, plural)
    return every


def _number(target: Any, attribute: str, where: str) -> Any:
    """Return the present value of an attribute that is a number or an array of numbers."""
    value = getattr(target, attribute, None)
    if isinstance(value, bool) or not isinstance(value, float | np.ndarray):
        numbers = [
            name
            for name in dir(target)
            if not name.startswith("_") and isinstance(_safe(target, name), float | np.ndarray)
        ]
        raise ModelError(f"{where}: {attribute} is no number of it; it has {', '.join(numbers)}")
    return value


def _safe(target: Any, name: str) -> Any:
    # Some attributes exist for some types of an element only, and raise for others.
    try:
        return getattr(target, name)
    except (AttributeError, TypeError, ValueError):
        return None


def _turns(joint: Any) -> bool:
    return joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL)


def _own_inertia(spec: mujoco.MjSpec, body: Any) -> None:
    """State the body's inertia in principal axes, as MuJoCo would compile it."""
    if body.explicitinertial and not np.isfinite(body.fullinertia[0]):
        return
    model = compiled(spec)
    number = model.body(body.name).id
    body.fullinertia[0] = np.nan
    body.explicitinertial = True
    body.mass = float(model.body_mass[number])
    body.inertia[:] = model.body_inertia[number]
    body.ipos[:] = model.body_ipos[number]
    body.iquat[:] = model.body_iquat[number]


def _check_overlap(found: Sequence[Change]) -> None:
    """Refuse two factors for one number: the second would undo the first in silence."""
    owners: dict[tuple[str, int], str] = {}
    for change in found:
        first = change.entries.start if change.entries else 0
        last = change.entries.stop if change.entries else 1
        stem = change.path.split("[")[0]
        for entry in range(first, last):
            owner = owners.setdefault((stem, entry), change.factor)
            if owner != change.factor:
                raise ModelError(
                    f"factors {owner} and {change.factor} both change {change.path[:80]!r}"
                )
