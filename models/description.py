"""What a model is to everybody who does not evaluate it: its factors, outputs, kind and digest."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import cached_property
from math import inf, isfinite
from typing import Any, Self

from models.curves import MAX_POINTS, Curve, columns
from models.entries import DescriptionError, check_columns, check_names, factor_of, fields_of
from models.factors import SEED, Factor, check_bounds, narrowest, no_factor

MAX_FACTORS = 1000
#: Of scalars, and of points of curves, all together.
MAX_OUTPUTS = 10_000
#: Hexadecimal digits of a digest in a model's name, as in "pendulum@3fa2...".
DIGEST_LENGTH = 16

#: A name, @ and a digest fit in the 64 characters that a study keeps.
_MODEL_NAME = re.compile(r"[a-z0-9_]{1,40}")

#: Entries of an output that say how to show it or when to ask for it, not what it is.
_AXIS = ("over", "over_unit", "low", "high", "optional")


class Kind(StrEnum):
    """How a model reaches a worker."""

    MJCF = "mjcf"
    PYTHON = "python"
    COMMAND = "command"
    UMBRIDGE = "umbridge"


@dataclass(frozen=True, kw_only=True)
class Output:
    """One number that an evaluation gives, or `curve` numbers along an axis."""

    name: str
    #: SI unit symbol; "1" if dimensionless.
    unit: str
    curve: int | None = None
    #: The axis of a curve, along which its points lie evenly: its name, unit and ends.
    over: str = ""
    over_unit: str = "1"
    low: float = 0.0
    high: float = 1.0
    #: Whether a study leaves it out unless it names it.
    optional: bool = False

    @property
    def axis(self) -> Curve | None:
        """The axis of a curve; None of a number."""
        if self.curve is None:
            return None
        over = self.over or "point"
        return Curve(
            points=self.curve, over=over, unit=self.over_unit, low=self.low, high=self.high
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its numbers: its own, or one for each point of the curve."""
        if self.curve is None:
            return (self.name,)
        return columns(self.name, self.curve)


@dataclass(frozen=True, kw_only=True)
class Description:
    """Something that maps named factors to named outputs."""

    name: str
    description: str
    kind: Kind
    factors: tuple[Factor, ...]
    results: tuple[Output, ...]
    #: Seconds of wall time that one evaluation may take; None: what the worker's owner allows.
    time_limit: float | None = None
    #: Whether equal parameters give equal bits on one machine; else the seed decides, too.
    deterministic: bool = True
    #: Digest of the files that evaluate it; empty for one that comes with rehyb.
    code: str = ""

    @cached_property
    def digest(self) -> str:
        """What tells two versions of a model apart; descriptions for readers do not count."""
        said = self._entries()
        for entry in (said, *said["factors"]):
            del entry["description"]
        for output in said["outputs"]:
            for name in _AXIS:
                output.pop(name, None)
        canonical = json.dumps(said, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()[:DIGEST_LENGTH]

    @property
    def version(self) -> str:
        """Name and digest, as a worker says which models it has."""
        return f"{self.name}@{self.digest}"

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Every number that a successful evaluation gives, in their order, and its unit.

        Unless it is asked for more: for optional outputs.
        """
        return {
            column: output.unit
            for output in self.results
            if not output.optional
            for column in output.columns
        }

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the numbers that a successful evaluation gives."""
        return tuple(self.units)

    @property
    def sources(self) -> tuple[Factor, ...]:
        """Its factors, and the seed if that decides, too."""
        return self.factors if self.deterministic else (*self.factors, SEED)

    @property
    def sampled(self) -> tuple[Factor, ...]:
        """What a study samples unless it says otherwise."""
        return tuple(source for source in self.sources if not source.optional)

    @property
    def curves(self) -> Mapping[str, Curve]:
        """The outputs that are curves, optional ones too, by name."""
        return {output.name: output.axis for output in self.results if output.axis is not None}

    def factor(self, name: str) -> Factor:
        """Return the factor (or the seed) called `name`; KeyError if the model has none."""
        for factor in self.sources:
            if factor.name == name:
                return factor
        raise KeyError(name)

    def as_json(self) -> dict[str, Any]:
        """Return it as plain JSON, which `from_json` reads; a bound that is infinite is null."""
        return {**self._entries(), "digest": self.digest}

    def _entries(self) -> dict[str, Any]:
        # Not `asdict`, which copies every text and number: a coordinator tells hundreds of them.
        said = {field.name: getattr(self, field.name) for field in fields(self)}
        outputs = [_without_defaults(vars(output)) for output in said.pop("results")]
        factors = [dict(vars(factor)) for factor in self.factors]
        for factor in factors:
            factor["choices"] = list(factor["choices"])
            factor["bounds"] = [bound if isfinite(bound) else None for bound in factor["bounds"]]
        return {**said, "kind": str(self.kind), "factors": factors, "outputs": outputs}

    @classmethod
    def from_json(cls, said: Any, *, kept: bool = False) -> Self:
        """Read a description that somebody sent.

        Args:
            kept: whether it was taken before; then its names may clash with columns of results.

        Raises:
            DescriptionError: something is missing, unknown or means nothing.
        """
        fields = fields_of(
            "model",
            said,
            needed={"name": str, "kind": str, "factors": list, "outputs": list},
            optional={
                "description": str,
                "time_limit": float,
                "deterministic": bool,
                "code": str,
                "digest": str,
            },
        )
        if not _MODEL_NAME.fullmatch(fields["name"]):
            raise DescriptionError(
                "model.name", f"{fields['name'][:80]!r} must be 1 to 40 of a to z, 0 to 9 and _"
            )
        if fields["kind"] not in [*Kind]:
            raise DescriptionError(
                "model.kind", f"{fields['kind'][:80]!r} must be one of {', '.join(Kind)}"
            )
        limit = fields.get("time_limit")
        if limit is not None and not 0.0 < limit <= 1e7:
            raise DescriptionError(
                "model.time_limit", f"must lie above 0 s and be at most 1e7 s, not {limit:g}"
            )
        if len(fields["factors"]) > MAX_FACTORS:
            raise DescriptionError(
                "factors", f"are {len(fields['factors'])}; at most {MAX_FACTORS}"
            )
        factors = tuple(factor_of(f"factors[{i}]", f) for i, f in enumerate(fields["factors"]))
        results = tuple(_output(f"outputs[{i}]", o) for i, o in enumerate(fields["outputs"]))
        check_names("factors", [factor.name for factor in factors], "factor")
        check_names("outputs", [output.name for output in results], "output")
        count = sum(output.curve or 1 for output in results)
        if count > MAX_OUTPUTS:
            raise DescriptionError("outputs", f"give {count} numbers; at most {MAX_OUTPUTS}")
        described = cls(
            name=fields["name"],
            description=fields.get("description", ""),
            kind=Kind(fields["kind"]),
            factors=factors,
            results=results,
            time_limit=limit,
            deterministic=fields.get("deterministic", True),
            code=fields.get("code", ""),
        )
        if not kept:
            described.check_columns()
            described._check_factors()
        return described

    def check_columns(self) -> None:
        """Raise a DescriptionError unless its factors and outputs can stand in one table."""
        check_columns([f.name for f in self.sources], [output.name for output in self.results])

    def _check_factors(self) -> None:
        """Raise a DescriptionError if nobody can tell a factor's choices or numbers apart."""
        for i, factor in enumerate(self.factors):
            if not all(choice.isprintable() and choice.strip() for choice in factor.choices):
                raise DescriptionError(
                    f"factors[{i}].choices", "must be names of characters that can be seen"
                )
            least = narrowest(factor.low, factor.high)
            if factor.high - factor.low < least:
                raise DescriptionError(
                    f"factors[{i}].high",
                    f"lies {factor.high - factor.low:g} above low, {factor.low:g}: numbers there "
                    f"are told apart by their last digits; it must be {least:.2g} or more",
                )


def complete(description: Description, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return a value for every factor, in their order; one left out takes its nominal value.

    Raises:
        ValueError: a factor is unknown, or a value is not finite or out of its bounds.
    """
    values = {factor.name: factor.nominal for factor in description.factors}
    for name, value in parameters.items():
        if name not in values:
            raise ValueError(no_factor(description.name, name, values))
        if not isfinite(value):
            raise ValueError(f"factor {name} must be finite, not {value}")
        values[name] = float(value)
    check_bounds(description.factors, values)
    return values


def _output(where: str, said: Any) -> Output:
    axis = {"over": str, "over_unit": str, "low": float, "high": float, "optional": bool}
    fields = fields_of(
        where, said, needed={"name": str, "unit": str}, optional={"curve": int, **axis}
    )
    curve = fields.get("curve")
    if curve is None:
        for name in ("over", "over_unit", "low", "high"):
            if name in fields:
                raise DescriptionError(f"{where}.{name}", "is for a curve only")
    elif not 2 <= curve <= MAX_POINTS:
        raise DescriptionError(f"{where}.curve", f"must be 2 to {MAX_POINTS} points, not {curve}")
    output = Output(**fields)
    if not -inf < output.low < output.high < inf:
        raise DescriptionError(
            f"{where}.high", f"{output.high:g} must lie above low, {output.low:g}"
        )
    return output


def _without_defaults(output: Mapping[str, Any]) -> dict[str, Any]:
    """Return an output's entries without what is said of few."""
    return {n: v for n, v in output.items() if n not in _AXIS or v != getattr(Output, n)}
