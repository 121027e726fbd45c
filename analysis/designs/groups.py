"""Groups of factors that move together (Campolongo, Cariboni and Saltelli 2007, section 4).

What indices are of is then a unit: a group, or a factor that is in none. A row has as many points
as a row of so many factors, which is what groups are for: a screening of twenty factors in four
groups takes five runs a row instead of twenty-one.
"""

from collections.abc import Iterable, Mapping, Sequence

from models.factors import SEED

#: Which factors, by their places, make up each unit.
Units = Sequence[Sequence[int]]


def units_of(
    factors: Iterable[str], groups: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, ...]]:
    """Return the factors of every unit by its name, each in the place of its first factor.

    (Campolongo et al. 2007.)
    """
    of = {factor: name for name, members in groups.items() for factor in members}
    units: dict[str, tuple[str, ...]] = {}
    for factor in factors:
        name = of.get(factor, factor)
        units[name] = (*units.get(name, ()), factor)
    return units


def places_of(factors: Sequence[str], groups: Mapping[str, Sequence[str]]) -> Units:
    """Return the places of the factors of every unit, in the order of `units_of`.

    Such are the groups of Campolongo et al. 2007.
    """
    place = {factor: i for i, factor in enumerate(factors)}
    return [[place[factor] for factor in unit] for unit in units_of(factors, groups).values()]


def fault_in(factors: Iterable[str], groups: Mapping[str, Sequence[str]]) -> tuple[str, str] | None:
    """Say which group of sampled factors is wrong and why in a sentence; None if none is.

    Groups share no factor (Campolongo et al. 2007).
    """
    known = list(factors)
    seen: dict[str, str] = {}
    for name, members in groups.items():
        if name == SEED.name:
            return name, f"{name} is what a model's own noise is called: call the group otherwise"
        if name in known:
            return name, f"{name} is the name of a factor: call the group otherwise"
        if not members:
            return name, f"{name} has no factors: name at least one, or leave it out"
        for factor in members:
            if factor not in known:
                return name, f"{name} has {factor}, which is not sampled: {', '.join(known)} are"
            if factor in seen:
                where = f"{seen[factor]} and {name}" if seen[factor] != name else f"{name} twice"
                return name, f"{factor} is in {where}: a factor is in one group only"
            seen[factor] = name
    return None
