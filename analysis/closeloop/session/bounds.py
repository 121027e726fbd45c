"""What no number of a model is: without an end, or so large that squares of it have no digits.

MuJoCo takes both. It writes an infinite number as 0, and a fit through one has no solution.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from analysis.closeloop.errors import SessionError

#: m and kg: beyond, nothing that a joint moves is meant, and squares of it have no digits left.
MAX_LENGTH, MAX_MASS = 1e3, 1e6
#: kg m2; dampers, springs, friction and armatures in SI units; rad or m.
MAX_INERTIA, MAX_OF_JOINT, MAX_POSITION = 1e12, 1e9, 1e6
#: m/s2 and m/s; kg/m3 and Pa s; the numbers of an actuator.
MAX_FLOW, MAX_FLUID, MAX_OF_ACTUATOR = 1e3, 1e6, 1e12


class Bound(NamedTuple):
    """An attribute, what it may be at most, and its numbers by element, (n, ...)."""

    element: str
    attribute: str
    most: float
    unit: str
    numbers: np.ndarray
    #: Whether an element has the attribute at all, (n,); None: each has.
    said: np.ndarray | None = None


def check_bounds(model: mujoco.MjModel, name: str) -> None:
    """Refuse a model with a number that is not finite, or that no joint, body or tendon has.

    Args:
        model: with hinges and slides alone.
        name: of its file, for errors.

    Raises:
        SessionError: names the element, the attribute, its value, and what would be right.
    """
    _check_sizes(model, name)
    for bound in (*_of_option(model), *_of_parts(model)):
        if not bound.numbers.size:
            continue
        rows = np.abs(bound.numbers).reshape(len(bound.numbers), -1)
        wrong = ~(rows <= bound.most) | ~np.isfinite(rows)
        if bound.said is not None:
            wrong &= bound.said[:, None]
        if wrong.any():
            at = int(np.argmax(wrong.any(axis=1)))
            value = bound.numbers.reshape(rows.shape)[at, int(np.argmax(wrong[at]))]
            why = f"{_called(model, bound, at)} has {bound.attribute}={value:g}; {_right(bound)}"
            raise SessionError(why, file=name)


def _right(bound: Bound) -> str:
    if bound.attribute.endswith("range"):
        return "both ends must be finite; leave out a range that has none"
    most = f" and at most {bound.most:g}" if np.isfinite(bound.most) else ""
    return f"it must be finite{most}{bound.unit and f', in {bound.unit}'}"


def _called(model: mujoco.MjModel, bound: Bound, at: int) -> str:
    if bound.element == "option":
        return "<option>"
    name = getattr(model, bound.element)(at).name[:60]
    return f"{bound.element} {name!r}" if name else f"{bound.element} {at}, which has no name,"


def _check_sizes(model: mujoco.MjModel, name: str) -> None:
    for word, most, numbers in (
        ("places", MAX_LENGTH, np.abs(np.hstack([model.body_pos, model.body_ipos])).max(axis=1)),
        ("masses", MAX_MASS, model.body_mass),
    ):
        worst = int(np.argmax(numbers))
        if not numbers[worst] < most:
            why = (
                f"body {model.body(worst).name[:60]!r} has {word} of {numbers[worst]:g}; lengths "
                f"are in m, masses in kg, and at most {most:g}"
            )
            raise SessionError(why, file=name)


def _of_option(model: mujoco.MjModel) -> Iterator[Bound]:
    option = model.opt
    for attribute, most, unit in (
        ("gravity", MAX_FLOW, "m/s2"),
        ("wind", MAX_FLOW, "m/s"),
        ("density", MAX_FLUID, "kg/m3"),
        ("viscosity", MAX_FLUID, "Pa s"),
        ("magnetic", np.inf, ""),
    ):
        yield Bound("option", attribute, most, unit, np.array([getattr(option, attribute)]))


def _of_parts(model: mujoco.MjModel) -> Iterator[Bound]:
    """Yield the numbers of joints, bodies, geoms, tendons and actuators."""
    free = np.inf
    yield Bound("joint", "damping", MAX_OF_JOINT, "Nm s/rad or N s/m", _with_poly(model, "dof"))
    yield Bound("joint", "stiffness", MAX_OF_JOINT, "Nm/rad or N/m", _with_poly(model, "jnt"))
    yield Bound("joint", "frictionloss", MAX_OF_JOINT, "Nm or N", model.dof_frictionloss)
    yield Bound("joint", "armature", MAX_OF_JOINT, "kg m2 or kg", model.dof_armature)
    yield Bound("joint", "ref", MAX_POSITION, "rad or m", model.qpos0)
    yield Bound("joint", "springref", MAX_POSITION, "rad or m", model.qpos_spring)
    yield Bound("joint", "pos", MAX_LENGTH, "m", model.jnt_pos)
    yield Bound("joint", "axis", free, "", model.jnt_axis)
    # What goes round and round has in published files a range of 1e16 rad.
    for attribute, word in (("range", ""), ("actuatorfrcrange", "actfrc")):
        numbers, there = _range(model, "jnt", word)
        yield Bound("joint", attribute, free, "", numbers, there)
    yield Bound("body", "inertia", MAX_INERTIA, "kg m2", model.body_inertia)
    yield Bound("body", "quat", free, "", np.hstack([model.body_quat, model.body_iquat]))
    yield Bound("body", "gravcomp", MAX_OF_JOINT, "", model.body_gravcomp)
    yield Bound("geom", "pos", MAX_POSITION, "m", model.geom_pos)
    yield Bound("geom", "size", MAX_POSITION, "m", model.geom_size)
    yield Bound("tendon", "damping", MAX_OF_JOINT, "SI units", _with_poly(model, "tendon"))
    for attribute in ("stiffness", "frictionloss", "armature"):
        numbers = getattr(model, f"tendon_{attribute}")
        yield Bound("tendon", attribute, MAX_OF_JOINT, "SI units", numbers)
    yield Bound("tendon", "springlength", MAX_POSITION, "m", model.tendon_lengthspring)
    yield Bound("tendon", "range", free, "", model.tendon_range, model.tendon_limited != 0)
    for attribute in ("gear", "gainprm", "biasprm", "dynprm"):
        numbers = getattr(model, f"actuator_{attribute}")
        yield Bound("actuator", attribute, MAX_OF_ACTUATOR, "", numbers)
    for word in ("ctrl", "force", "act"):
        numbers, there = _range(model, "actuator", word)
        yield Bound("actuator", f"{word}range", free, "", numbers, there)


def _range(model: mujoco.MjModel, kind: str, word: str) -> tuple[np.ndarray, np.ndarray]:
    """Return ranges, (n, 2), and which have an end: MuJoCo writes one with none as no range."""
    numbers = getattr(model, f"{kind}_{word}range")
    return numbers, (getattr(model, f"{kind}_{word}limited") != 0) & ~np.isinf(numbers).all(axis=1)


def _with_poly(model: mujoco.MjModel, kind: str) -> np.ndarray:
    """Return dampings of `dof` or `tendon`, stiffnesses of `jnt`, with those of higher powers."""
    word = "stiffness" if kind == "jnt" else "damping"
    plain = getattr(model, f"{kind}_{word}")
    return np.hstack([plain[:, None], getattr(model, f"{kind}_{word}poly")])
