"""Outputs that are curves: their axis, and how their points are named, sent and stored.

Inside, a curve is one number per point, `torque[0]` to `torque[100]`, like any other output. A
result that travels has them as one list, and one that is stored as one text: the little-endian
doubles in base64, which is a third of the JSON.
"""

import binascii
from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from struct import error as struct_error
from struct import pack, unpack
from typing import Any, Self

#: Of one curve, and of all numbers of a model together.
MAX_POINTS = 10_000

_START = "f8:"


class CurveError(ValueError):
    """These are not the points of that curve; the message says in one sentence why."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Points of an output that lie evenly along an axis."""

    points: int
    #: What it is over: "time", "phase", or a sensor that grows.
    over: str
    #: SI unit symbol of the axis; "1" if it is a share.
    unit: str = "1"
    #: Where the first and the last point are.
    low: float = 0.0
    high: float = 1.0

    def axis(self) -> list[float]:
        """Return where each point is, in the axis's unit."""
        if self.points == 1:
            return [self.low]
        step = (self.high - self.low) / (self.points - 1)
        return [self.low + step * i for i in range(self.points - 1)] + [self.high]

    def as_json(self) -> dict[str, Any]:
        """Return it as plain JSON, which `from_json` reads."""
        return asdict(self)

    @classmethod
    def from_json(cls, said: Mapping[str, Any]) -> Self:
        """Return what `as_json` returned."""
        return cls(**said)


def columns(name: str, points: int) -> tuple[str, ...]:
    """Return the names of a curve's points."""
    return tuple(f"{name}[{i}]" for i in range(points))


def names_of(outputs: Iterable[str], curves: Mapping[str, Curve]) -> list[str]:
    """Return the names of outputs, each of `curves` once in the place of its points."""
    return list(folded(dict.fromkeys(outputs, 0.0), curves))


def columns_of(names: Iterable[str], curves: Mapping[str, Curve]) -> tuple[str, ...]:
    """Return the names of all numbers of outputs: the inverse of `names_of`."""
    return tuple(
        column
        for name in names
        for column in (columns(name, curves[name].points) if name in curves else (name,))
    )


def folded(outputs: Mapping[str, float], curves: Mapping[str, Curve]) -> dict[str, Any]:
    """Return outputs with the points of each of `curves` as one list under its name.

    It stands where its first point stood; other outputs stay as they are.
    """
    if not curves:
        return dict(outputs)
    inside = {
        column: name for name, curve in curves.items() for column in columns(name, curve.points)
    }
    found: dict[str, Any] = {}
    for column, value in outputs.items():
        if column in inside:
            found.setdefault(inside[column], []).append(value)
        else:
            found[column] = value
    return found


def unfolded(outputs: Mapping[str, Any], curves: Mapping[str, Curve]) -> dict[str, Any]:
    """Return outputs with one entry per point: the inverse of `folded`.

    Raises:
        CurveError: what stands for a curve is no list, or one of another length.
    """
    found: dict[str, Any] = {}
    for name, value in outputs.items():
        if name not in curves:
            found[name] = value
            continue
        points = curves[name].points
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise CurveError(f"output {name} must be a list of {points} numbers")
        if len(value) != points:
            raise CurveError(f"output {name} must have {points} points, not {len(value)}")
        found |= zip(columns(name, points), value, strict=True)
    return found


def packed(outputs: Mapping[str, float]) -> dict[str, Any]:
    """Return outputs with each run of points `name[0]`, `name[1]`, ... as one text."""
    # Most outputs are no curves, and a coordinator stores thousands of them in a second.
    if not any(name.endswith("]") for name in outputs):
        return dict(outputs)
    found: dict[str, Any] = {}
    names = list(outputs)
    at = 0
    while at < len(names):
        name = names[at].removesuffix("[0]")
        stop = at
        while stop < len(names) and names[stop] == f"{name}[{stop - at}]":
            stop += 1
        if stop - at > 1:
            points = pack(f"<{stop - at}d", *(outputs[column] for column in names[at:stop]))
            found[name] = _START + b64encode(points).decode()
            at = stop
        else:
            found[names[at]] = outputs[names[at]]
            at += 1
    return found


def unpacked(stored: Mapping[str, Any]) -> dict[str, float]:
    """Return the outputs that `packed` was given, to the bit.

    Raises:
        CurveError: a text in them is not one of `packed`.
    """
    if not any(isinstance(value, str) for value in stored.values()):
        return dict(stored)
    found: dict[str, float] = {}
    for name, value in stored.items():
        if not isinstance(value, str):
            found[name] = value
            continue
        try:
            data = b64decode(value.removeprefix(_START), validate=True)
            points = unpack(f"<{len(data) // 8}d", data)
        except (binascii.Error, struct_error):
            raise CurveError(f"output {name} is stored as no curve") from None
        found |= zip(columns(name, len(points)), points, strict=True)
    return found
