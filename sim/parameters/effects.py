"""Effects that the simulated arm or robot has and the nominal model lacks, as factors of a study.

What closing the loop finds in measured trials goes back into the simulated assessment under its
name: the parameter PARAM of the effect NAME is the factor `effect.NAME.PARAM`. The effects' laws
need numpy, so they are imported where factors are asked for: a worker's parent process never asks.
"""

from collections.abc import Mapping
from functools import cache
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING

from models.factors import Factor

if TYPE_CHECKING:
    from sim.effects.parameter import Values

PREFIX = "effect."


@cache
def effect_factors() -> tuple[Factor, ...]:
    """Return every parameter of every effect as a factor; off unless a study asks for it."""
    from sim.effects.catalogue import ASSESSED

    return tuple(
        Factor(
            name=f"{PREFIX}{effect.name}.{name}",
            unit=parameter.unit,
            low=parameter.low,
            high=parameter.high,
            nominal=parameter.neutral,
            description=f"{effect.name}: {parameter.description}",
            bounds=(parameter.floor, parameter.ceiling),
            optional=True,
        )
        for effect in ASSESSED.values()
        for name, parameter in effect.parameters.items()
    )


def effects_of(values: "Values") -> Mapping[str, "Values"]:
    """Return the effects that are on, each with all its parameters.

    Args:
        values: `effect.NAME.PARAM` to value (SI units); one left out is neutral.

    Raises:
        ValueError: a name is unknown, or a value means nothing.
    """
    from sim.effects.catalogue import ASSESSED

    known = {factor.name for factor in effect_factors()}
    for name in values:
        if name not in known:
            raise ValueError(
                f"there is no effect factor {name!r}: take effect.NAME.PARAMETER with NAME one of "
                f"{', '.join(ASSESSED)}"
            )
    found: dict[str, Values] = {}
    for effect in ASSESSED.values():
        own = {
            name: float(values.get(f"{PREFIX}{effect.name}.{name}", parameter.neutral))
            for name, parameter in effect.parameters.items()
        }
        for name, parameter in effect.parameters.items():
            if not isfinite(own[name]) or not parameter.floor <= own[name] <= parameter.ceiling:
                raise ValueError(
                    f"{PREFIX}{effect.name}.{name} must be finite, at least {parameter.floor:g} "
                    f"and at most {parameter.ceiling:g}, not {own[name]:g}"
                )
        if any(own[name] != p.neutral for name, p in effect.parameters.items() if p.switches):
            found[effect.name] = MappingProxyType(own)
    return MappingProxyType(found)
