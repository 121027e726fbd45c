"""How a study's plan is drawn up from a request."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from types import MappingProxyType
from typing import Any

from analysis.designs import (
    DEPENDENT,
    METHODS,
    SINGLE_POINTS,
    TRAJECTORIES,
    fewest_factors,
    samplings,
)
from analysis.designs.dependence import KINDS, Dependence, DependenceError, copula
from analysis.designs.distributions import Distribution
from analysis.designs.groups import fault_in, units_of
from analysis.json_values import is_finite_number
from analysis.sensitivity.fewer_runs.limits import MOST_RUNS
from models.curves import columns_of
from models.description import Description
from models.entries import DescriptionError
from models.factors import SEED, Factor, check_bounds, narrowest, no_factor
from server.errors import InvalidStudyError
from server.records import Plan

#: Sobol points are numbered in 30 bits, and the analysis keeps a byte of memory for each row.
MAX_ROWS = 100_000_000

#: Probability of a tail that may reach anywhere.
TAIL = 1e-3

#: Of a width below it the square, of which variances are made, is 0.
NARROWEST = 1e-150

#: What to do instead.
_WITH_CORRELATIONS = f"with correlations the method is {' or '.join(DEPENDENT)}"


@dataclass(frozen=True, kw_only=True)
class FactorChoice:
    """How a request wants one factor sampled: a range, a distribution, or the model's own range."""

    name: str
    range: Sequence[float] | None = None
    distribution: Mapping[str, Any] | None = None


def draw_up(
    *,
    name: str,
    model: Description,
    called: str,
    method: str,
    sampling: str,
    rows: int,
    seed: int,
    factors: Sequence[FactorChoice] | None,
    fixed: Mapping[str, float | str],
    outputs: Sequence[str] | None,
    correlations: Sequence[Sequence[Any]] = (),
    correlation_kind: str = "rank",
    groups: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> Plan:
    """Check a request and complete it from the model's own factors and outputs.

    Factors left out altogether (None) means: sample every factor that is not fixed, uniformly over
    its own range. A factor neither sampled nor fixed keeps its nominal value.

    Args:
        model: what is sampled.
        called: what the study calls it: see `ModelVersion.called`.
        correlations: [factor, factor, number] of every pair that depends on each other.
        correlation_kind: one of `analysis.designs.dependence.KINDS`.
        groups: factors that move together, by name.

    Raises:
        InvalidStudyError: with a pointer to what is wrong and a sentence saying what is right.
    """
    try:
        model.check_columns()
    except DescriptionError as error:
        raise InvalidStudyError("/model", f"{called} cannot be sampled: {error}") from None
    _known("/method", "method", method, METHODS)
    _known("/sampling", "sampling", sampling, samplings(method))
    check_rows(method, rows)
    known = [source.name for source in model.sources]
    numbers = _fixed(model, fixed)
    if factors is None:
        factors = [
            FactorChoice(name=factor.name) for factor in model.sampled if factor.name not in numbers
        ]
    elif not model.deterministic and SEED.name not in {*numbers, *(f.name for f in factors)}:
        # Its noise is there whatever is sampled.
        factors = [*factors, FactorChoice(name=SEED.name)]
    sampled = _sampled(model, factors, numbers)
    kept = _outputs(model, outputs)
    if method in ("shapley", *SINGLE_POINTS) and (
        curved := [name for name in kept if name in model.curves]
    ):
        if outputs is not None or len(curved) == len(kept):
            whole = any(one.name == curved[0] and one.optional for one in model.results)
            point = columns_of(curved, model.curves)[0]
            raise InvalidStudyError(
                "/outputs" if outputs is None else f"/outputs/{outputs.index(curved[0])}",
                f"{curved[0]} is a curve, and {method} takes numbers only: "
                + ("leave it out" if whole else f"keep points of it, such as {point}"),
            )
        kept = tuple(name for name in kept if name not in curved)
    _check_groups(groups, [factor for factor in known if factor in sampled], method, sampling)
    if len(units_of(sampled, groups)) < fewest_factors(method):
        what = "shares out among factors" if method == "shapley" else "looks at pairs"
        raise InvalidStudyError("/factors", f"{method} {what}: it needs two factors or more")
    distributions = {factor: sampled[factor] for factor in known if factor in sampled}
    return Plan(
        name=name,
        model=called,
        method=method,
        sampling=sampling,
        rows=rows,
        seed=seed,
        distributions=distributions,
        dependence=_dependence(method, distributions, correlations, correlation_kind),
        fixed={
            factor.name: numbers.get(factor.name, factor.nominal)
            for factor in model.sources
            if factor.name not in sampled
        },
        outputs=columns_of(kept, model.curves),
        groups={name: tuple(members) for name, members in groups.items()},
        curves={name: curve for name, curve in model.curves.items() if name in kept},
    )


def _alone(method: str) -> str:
    """Say why factors that depend on each other are none for a method."""
    if method == "surrogate":
        return "tells a factor's part of its function from the others', as only independent ones do"
    return "moves one factor and leaves the others alone, which dependent factors do not allow"


def _dependence(
    method: str,
    distributions: Mapping[str, Distribution],
    correlations: Sequence[Sequence[Any]],
    kind: str,
) -> Dependence | None:
    """Return how factors depend on each other, if they do and can."""
    _known("/correlation_kind", "correlation_kind", kind, KINDS)
    if not correlations:
        return None
    if method not in DEPENDENT:
        raise InvalidStudyError("/method", f"{method} {_alone(method)}: {_WITH_CORRELATIONS}")
    pairs: list[tuple[str, str, float]] = []
    for i, entry in enumerate(correlations):
        if not (
            len(entry) == 3
            and isinstance(entry[0], str)
            and isinstance(entry[1], str)
            and is_finite_number(entry[2])
        ):
            raise InvalidStudyError(
                f"/correlations/{i}", 'a correlation is two factors and a number: ["a", "b", 0.6]'
            )
        pairs.append((entry[0], entry[1], float(entry[2])))
    found = Dependence(pairs=tuple(pairs), kind=kind)
    try:
        copula(found, tuple(distributions), tuple(distributions.values()))
    except DependenceError as error:
        at = "" if error.place is None else f"/{error.place}"
        raise InvalidStudyError(f"/correlations{at}", str(error)) from None
    return found


def _check_groups(
    groups: Mapping[str, Sequence[str]], sampled: Sequence[str], method: str, sampling: str
) -> None:
    if (fault := fault_in(sampled, groups)) is not None:
        raise InvalidStudyError(f"/groups/{fault[0]}", fault[1])
    if groups and method in ("shapley", *SINGLE_POINTS):
        raise InvalidStudyError("/groups", f"{method} looks at single factors, not at groups")
    if groups and method == "morris" and sampling not in TRAJECTORIES:
        raise InvalidStudyError(
            "/sampling",
            "groups of morris move along trajectories: sampling must be random_trajectories, not "
            f"{sampling}",
        )


def check_rows(method: str, rows: int) -> None:
    """Raise InvalidStudyError if no study of a method can have so many rows."""
    if not 1 <= rows <= MAX_ROWS:
        raise InvalidStudyError("/rows", f"rows must lie between 1 and {MAX_ROWS}, not {rows}")
    if method == "surrogate" and rows > MOST_RUNS:
        raise InvalidStudyError(
            "/rows", f"surrogate fits a function to {MOST_RUNS} rows at most, not {rows}"
        )


def _fixed(model: Description, fixed: Mapping[str, float | str]) -> dict[str, float]:
    """Return the fixed values as numbers; that of a choice may be its name."""
    known = {source.name: source for source in model.sources}
    numbers = {}
    for name, value in fixed.items():
        pointer = f"/fixed/{name}"
        factor = _factor(pointer, model, name, known)
        try:
            numbers[name] = factor.number(value)
        except ValueError as error:
            raise InvalidStudyError(pointer, str(error)) from None
        if not isfinite(numbers[name]):
            raise InvalidStudyError(pointer, f"{name} must be finite, not {value}")
        if factor is SEED and not (numbers[name].is_integer() and 0 <= numbers[name] < SEED.high):
            raise InvalidStudyError(
                pointer, f"seed must be a whole number from 0 below 2^32, not {value}"
            )
        _check_meaning(pointer, factor, (numbers[name],))
    return numbers


def _factor(pointer: str, model: Description, name: str, known: Mapping[str, Factor]) -> Factor:
    if name not in known:
        raise InvalidStudyError(pointer, no_factor(model.name, name, known))
    return known[name]


def refuse_outside_range(plan: Plan, model: Description, asked: Sequence[str]) -> None:
    """Refuse a plan with values far outside the ranges for which its model was validated.

    Args:
        plan: as it was drawn up.
        model: what is sampled.
        asked: names of the factors to sample, as the request lists them.

    Raises:
        InvalidStudyError: with a pointer to the first such factor.
    """
    for factor in model.factors:
        distribution = plan.distributions.get(factor.name)
        if distribution is not None:
            place = f"factors/{asked.index(factor.name)}" if factor.name in asked else "factors"
            ends = _ends(distribution)
        else:
            place, ends = f"fixed/{factor.name}", (plan.fixed[factor.name],)
        try:
            factor.check_reach(*ends)
        except ValueError as error:
            raise InvalidStudyError(
                f"/{place}", f'{error}, or ask for it with "outside_range": true (--outside-range)'
            ) from None


def _ends(distribution: Distribution) -> tuple[float, ...]:
    """Return the lowest and the highest value; where there is none, what tails lie beyond."""
    given = distribution.to_json()
    if "low" in given:
        return given["low"], given["high"]
    return tuple(distribution.ppf([TAIL, 1.0 - TAIL]).tolist())


def _known(pointer: str, what: str, name: str, known: Any) -> Any:
    """Return what `known` has under `name` (or the name itself, if it is a plain sequence)."""
    if name not in known:
        raise InvalidStudyError(
            pointer, f"unknown {what} {name!r}: expected one of {', '.join(known)}"
        )
    return known[name] if isinstance(known, Mapping) else name


def _sampled(
    model: Description, choices: Sequence[FactorChoice], fixed: Mapping[str, float]
) -> dict[str, Distribution]:
    """Return the distribution of every factor that `choices` asks to sample."""
    if not choices:
        raise InvalidStudyError("/factors", "a study must sample at least one factor")
    known = {source.name: source for source in model.sources}
    sampled: dict[str, Distribution] = {}
    for i, choice in enumerate(choices):
        pointer = f"/factors/{i}"
        factor = _factor(f"{pointer}/name", model, choice.name, known)
        if choice.name in sampled:
            raise InvalidStudyError(f"{pointer}/name", f"{choice.name} is listed twice")
        if choice.name in fixed:
            raise InvalidStudyError(
                f"{pointer}/name", f"{choice.name} cannot be both fixed and sampled"
            )
        if choice.range is not None and choice.distribution is not None:
            raise InvalidStudyError(pointer, f"{choice.name}: give a range or a distribution")
        sampled[choice.name] = _distribution(factor, choice, pointer)
    return sampled


def _distribution(factor: Factor, choice: FactorChoice, pointer: str) -> Distribution:
    """Return the distribution one choice means; the model's own range if it names none."""
    if choice.distribution is not None:
        pointer, described = f"{pointer}/distribution", dict(choice.distribution)
    else:
        low, high = choice.range or (factor.low, factor.high)
        pointer, described = f"{pointer}/range", {"kind": "uniform", "low": low, "high": high}
        if factor.choices:
            if choice.range is not None:
                raise InvalidStudyError(pointer, _of_choices(factor))
            count = len(factor.choices)
            described = {
                "kind": "discrete",
                "values": list(map(float, range(count))),
                "probabilities": [1.0 / count] * count,
            }
    try:
        found = Distribution.from_json(described)
    except ValueError as error:
        raise InvalidStudyError(pointer, f"{choice.name}: {error}") from error
    least = max(NARROWEST, narrowest(*_ends(found)))
    if (width := found.scale.width) < least:
        raise InvalidStudyError(
            pointer,
            f"{choice.name} would vary by {width:g} only: by {least:.2g} or more, or fix it",
        )
    if factor.choices and "values" not in described:
        raise InvalidStudyError(pointer, _of_choices(factor))
    _check_meaning(pointer, factor, described.get("values") or _ends(found))
    return found


def _of_choices(factor: Factor) -> str:
    return (
        f"{factor.name} is a choice ({', '.join(factor.choices)}): leave the range out, or give a "
        "discrete distribution of their numbers, from 0"
    )


def _check_meaning(pointer: str, factor: Factor, values: Iterable[float]) -> None:
    """Refuse values that mean nothing to the model, as every run would do."""
    for value in values:
        try:
            check_bounds((factor,), {factor.name: float(value)})
        except ValueError as error:
            raise InvalidStudyError(pointer, str(error)) from None


def _outputs(model: Description, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Return the outputs to keep, in the model's order; a curve is one, and so is a point of it."""
    names = [output.name for output in model.results]
    if wanted is None:
        if always := tuple(output.name for output in model.results if not output.optional):
            return always
        raise InvalidStudyError(
            "/outputs",
            f"every output of {model.name} is optional: name those to keep, of {', '.join(names)}",
        )
    if not wanted:
        raise InvalidStudyError("/outputs", "a study must keep at least one output")
    points = {
        column: output.name
        for output in model.results
        if output.curve is not None and not output.optional
        for column in output.columns
    }
    for i, output in enumerate(wanted):
        if output not in points:
            _known(f"/outputs/{i}", f"output of {model.name}", output, names)
        if output in wanted[:i]:
            raise InvalidStudyError(f"/outputs/{i}", f"{output} is listed twice")
        if points.get(output) in wanted:
            raise InvalidStudyError(
                f"/outputs/{i}", f"{output} is a point of {points[output]}, which is kept whole"
            )
    return tuple(output for output in (*names, *points) if output in wanted)
