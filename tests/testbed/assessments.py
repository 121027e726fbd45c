"""Assessments that several tests look at, each simulated once."""

from collections.abc import Callable, Mapping
from functools import cache
from inspect import signature
from typing import Any

from sim.assessment.assess import Assessment, assess
from sim.models import ELBOW

LONG_HEAVY_STIFF = {
    "upper_arm_length": 0.3778,
    "forearm_length": 0.3455,
    "forearm_mass": 1.82,
    "upper_arm_elasticity": 974.43,
    "forearm_elasticity": 974.43,
}

#: `assess` with a memory: who takes an assessment from it must leave it as it is.
Assess = Callable[..., Assessment]


def remembering() -> Assess:
    """Return `assess` with a memory; to it what is nominal or a default is the same as none."""
    nominal = {factor.name: factor.nominal for factor in ELBOW.factors}
    defaults = {name: option.default for name, option in signature(assess).parameters.items()}

    @cache
    def simulate(values: frozenset[tuple[str, float]], options: frozenset[Any]) -> Assessment:
        return assess(dict(values), **dict(options))

    def remember(values: Mapping[str, float], **options: Any) -> Assessment:
        changed = {name: x for name, x in values.items() if x != nominal.get(name)}
        chosen = {name: option for name, option in options.items() if option != defaults[name]}
        return simulate(frozenset(changed.items()), frozenset(chosen.items()))

    return remember
