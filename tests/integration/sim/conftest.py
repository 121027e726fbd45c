"""Assessments that several tests look at, each simulated once a session."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import pytest

from sim.assessment.assess import Assessment, assess
from sim.models import ELBOW

#: `assess` with a memory, so that a test may not change what it returns.
Assess = Callable[..., Assessment]


@pytest.fixture(scope="session")
def assessed() -> Assess:
    """Return an assessment of factor values with options of `assess`; a nominal value is no key."""
    nominal = {factor.name: factor.nominal for factor in ELBOW.factors}

    @cache
    def simulate(values: frozenset[tuple[str, float]], options: frozenset[Any]) -> Assessment:
        return assess(dict(values), **dict(options))

    def remember(values: Mapping[str, float], **options: str) -> Assessment:
        changed = {name: x for name, x in values.items() if x != nominal.get(name)}
        return simulate(frozenset(changed.items()), frozenset(options.items()))

    return remember


@pytest.fixture(scope="session")
def nominal(assessed: Assess) -> Assessment:
    """Return the nominal wearer's assessment in contact."""
    return assessed({})
