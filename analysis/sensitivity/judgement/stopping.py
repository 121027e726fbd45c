"""How many more rows a wanted precision needs, from the intervals so far, and when to add them.

Width is the measure of convergence of Sarrazin, Pianosi and Wagener 2016 (Global sensitivity
analysis of environmental models: convergence and validation). It falls with the square root of the
number of rows, and faster for Sobol points, so the advice is cautious there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, inf, log10
from typing import Any

from analysis.designs import family, row_width
from analysis.designs.points import LATIN_HYPERCUBE_ROWS
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.fewer_runs.limits import (
    FEWEST_RUNS,
    LEAST_EXPLAINED,
    LOOKS,
    MOST_RUNS,
    ROUNDING,
)
from analysis.sensitivity.judgement.trust import FEWEST_ROWS
from analysis.sensitivity.records import output_of, said_of

#: Half width wanted of variance shares, and of mu* as a share of the largest mu*.
SHARE_TARGET = 0.02
EFFECT_TARGET = 0.1

#: Shares lie between 0 and 1, so an interval of this half width says nothing of one.
NO_TARGET = 0.5
#: And no study has rows enough for one of less: 1e8 rows of Sobol points come to about 1e-5.
LEAST_TARGET = 1e-6
#: Most further rows that are forecast, far more than any study has: to say how many more would tell
#: nobody anything, and of a target like 1e-200 it is a number that no float can be.
MOST_FORECAST = 10**12

#: By family of methods: the indices that must be precise.
WANTED = {
    "morris": ("mu_star",),
    "saltelli": ("first_order", "total_order"),
    "shapley": ("shapley",),
}


@dataclass(frozen=True, kw_only=True)
class Advice:
    """What a study still needs."""

    #: Half width wanted of every interval, in the index's unit.
    target: float
    #: The widest interval's half width, and whose it is: a factor and an index.
    half_width: float
    factor: str
    index: str
    #: Rows and runs still needed beyond those that are complete; 0 if the target is reached.
    more_rows: int
    more_runs: int
    sentence: str


def check_target(target: float | None, method: str | None = None) -> None:
    """Check a wanted half width (Sarrazin et al. 2016), of indices of `method` if one is given.

    Effects are in the output's unit, so any positive one may be wanted of them.

    Raises:
        ValueError: it is not positive, or shares of a variance are within it whatever they are.
    """
    if target is None:
        return
    if not 0.0 < target < inf:
        raise ValueError(f"target is a positive half width of an interval, not {target:g}")
    if method is not None and family(method) != "morris" and target >= NO_TARGET:
        raise ValueError(
            f"target must be below {NO_TARGET}, not {target:g}: a share of the variance lies "
            f"between 0 and 1, so ±{target:g} says nothing of it"
        )
    if method is not None and family(method) != "morris" and target < LEAST_TARGET:
        raise ValueError(
            f"target must be {LEAST_TARGET:g} or more, not {target:g}: no study has rows enough to "
            "tell a share of the variance, between 0 and 1, more precisely"
        )


def advise(snapshot: Mapping[str, Any], output: str, target: float | None = None) -> Advice | None:
    """Say how many more rows bring every interval to ± `target` (Sarrazin et al. 2016).

    Args:
        snapshot: of a study.
        output: one of its outputs.
        target: half width, in the index's unit; default: 0.02 for variance shares, a tenth of the
            largest mu* for elementary effects.

    Returns:
        None while an index has no interval.

    Raises:
        ValueError: the target is not positive, or the study has no such output.
    """
    check_target(target)
    factors = output_of(snapshot, output)["factors"]
    wanted = WANTED[family(snapshot["method"])]
    entries = [(factor, name, factors[factor][name]) for factor in factors for name in wanted]
    if any(None in entry.values() for _, _, entry in entries):
        return None
    if target is None:
        target = SHARE_TARGET
        if snapshot["method"] == "morris":
            target = EFFECT_TARGET * max(entry["value"] for _, _, entry in entries)
    factor, name, widest = max(entries, key=lambda entry: _half(entry[2]))
    half = _half(widest)
    complete = snapshot["rows_complete"]
    more = 0 if half <= target or target == 0.0 else _more_rows(complete, half / target)
    runs = more * row_width(snapshot["method"], len(factors))
    reach = f"±{target:.2g}"
    now = f"the widest interval, {SYMBOLS[name]} of {factor}, has ±{half:.2g}"
    if more == 0:
        sentence = f"Every index of {output} is within {reach}: {now}."
        if not output_of(snapshot, output).get("trust", {}).get("trusted", True):
            sentence = f"Intervals of {output} are within {reach}, but not to be trusted: {now}."
    else:
        sobol = snapshot["sampling"].startswith(("owen", "sobol")) and name != "mu_star"
        about = "At most about" if sobol else "About"
        about = "More than" if more == MOST_FORECAST else about
        sentence = f"{about} {more:,} more rows ({runs:,} runs) bring {output} to {reach}: {now}."
        if snapshot["method"] == "surrogate" and complete + more > MOST_RUNS:
            sentence = f"More than the {MOST_RUNS} runs that a function is fitted to: {now}."
        elif sobol:
            whole = 1 << (complete + more - 1).bit_length()
            sentence += f" Sobol points serve best at a power of two: {whole:,} rows in all."
    return Advice(
        target=target,
        half_width=half,
        factor=factor,
        index=name,
        more_rows=more,
        more_runs=runs,
        sentence=sentence,
    )


@dataclass(frozen=True, kw_only=True)
class Goal:
    """How precise the indices of one output should become, and what that may cost."""

    output: str
    #: Half width of every interval; None: as `advise` has it.
    target: float | None
    #: The study is not extended beyond this many rows.
    up_to: int


@dataclass(frozen=True, kw_only=True)
class Step:
    """What a study with a goal does when all its rows are in."""

    #: How many rows it will have in all; None if it is extended no more.
    rows: int | None
    #: Whether every interval is as narrow as wanted, and to be trusted.
    reached: bool
    sentence: str


def next_step(snapshot: Mapping[str, Any], goal: Goal, rows: int) -> Step | None:
    """Decide whether a study is extended, and to how many rows.

    By the widths of its intervals, as Sarrazin et al. 2016 judge convergence, and only where they
    can be trusted (see `trust`). It never more than doubles, since a forecast from
    few rows is a rough one. Sobol sequences grow to powers of two, and Latin hypercubes by whole
    hypercubes, where they are balanced. A study of method surrogate grows from look to look, and
    gives up after the last one, or where its function explains too little
    (`analysis.sensitivity.fewer_runs.limits`).

    Args:
        snapshot: of the study.
        goal: what is wanted of it.
        rows: how many rows the study has now.

    Returns:
        None while the snapshot lacks a row: the first rows to come in are not a fair sample.

    Raises:
        ValueError: as `advise`.
    """
    if snapshot["rows_complete"] != rows:
        return None
    if snapshot["method"] == "surrogate":
        return _next_look(snapshot, goal, rows)
    advice = advise(snapshot, goal.output, goal.target)
    if advice is None:
        why = no_spread(snapshot, goal.output) or _failed(snapshot)
        if why or rows >= goal.up_to:
            why = why or "So few tell none."
            said = f"After {rows:,} rows {goal.output} has no intervals. {why}"
            return Step(rows=None, reached=False, sentence=said)
        wanted = min(1 << rows.bit_length(), goal.up_to)
        said = f"It is extended to {wanted:,} rows: so few tell no interval of {goal.output}."
        return Step(rows=wanted, reached=False, sentence=said)
    trust = output_of(snapshot, goal.output).get("trust", {})
    doubt = _doubt(trust, rows)
    if advice.more_rows == 0 and not doubt:
        seen = trust.get("unseen")
        unseen = f" What fewer than {seen:.2g} of the runs show may be unseen." if seen else ""
        return Step(rows=None, reached=True, sentence=advice.sentence + unseen)
    said = advice.sentence + (f" {doubt}" if doubt else "")
    if rows >= goal.up_to:
        why = f"It has its {rows:,} rows, and {goal.up_to:,} at most were allowed. "
        return Step(rows=None, reached=False, sentence=why + said)
    wanted = min(rows + advice.more_rows, 2 * rows) if advice.more_rows else 2 * rows
    if snapshot["sampling"] == "latin_hypercube":
        wanted = -(-wanted // LATIN_HYPERCUBE_ROWS) * LATIN_HYPERCUBE_ROWS
    else:
        wanted = 1 << rows.bit_length()
    wanted = min(wanted, goal.up_to)
    return Step(
        rows=wanted,
        reached=False,
        sentence=f"It is extended to {wanted:,} rows. {said}",
    )


def _next_look(snapshot: Mapping[str, Any], goal: Goal, rows: int) -> Step:
    """Decide for a study whose indices are those of a fitted function."""
    entry, target = output_of(snapshot, goal.output), goal.target or SHARE_TARGET
    fitted, trust = entry.get("surrogate"), entry["trust"]
    said, explained = f"After {rows:,} runs {goal.output} has no indices.", 1.0
    if fitted is None:
        why = no_spread(snapshot, goal.output) or _failed(snapshot)
        said += f" {why}" if why else ""
    else:
        ends = [
            (_half(found[index]), SYMBOLS[index], factor)
            for factor, found in entry["factors"].items()
            for index in WANTED["saltelli"]
        ]
        half, index, factor = max(ends)
        explained = fitted["explained"]
        said = (
            f"A {fitted['kind']} fitted to {fitted['runs']} runs explains "
            f"{max(explained, 0.0):.1%} of the variance of {goal.output} in those held out; the "
            f"widest interval, {index} of "
            f"{factor}, has ±{half:.2g} (wanted: ±{target:.2g})."
        )
        if half <= target and trust["trusted"]:
            unseen = f" What fewer than {trust['unseen']:.2g} of the runs show may be unseen."
            return Step(rows=None, reached=True, sentence=said + unseen)
        said += f" {trust['sentence']}" if trust["sentence"] else ""
    most = min(goal.up_to, MOST_RUNS)
    hopeless = rows >= FEWEST_RUNS and (fitted is None or explained < LEAST_EXPLAINED)
    if hopeless or rows >= most:
        more = "" if rows < most or most == MOST_RUNS else f" {most:,} runs at most were allowed."
        instead = " Indices as precise as that need a study of method saltelli." if fitted else ""
        return Step(rows=None, reached=False, sentence=said + more + instead)
    wanted = min(next(look for look in LOOKS if look > rows), most)
    return Step(rows=wanted, reached=False, sentence=f"It is extended to {wanted:,} rows. {said}")


def no_spread(snapshot: Mapping[str, Any], output: str) -> str:
    """Return that an output is the same in every run; empty if it is not, or not known yet."""
    entry = said_of(snapshot, output)
    mean, sd = entry.get("mean"), entry.get("sd")
    if mean is None or sd is None or sd > ROUNDING * abs(mean):
        return ""
    if sd > 0.0:
        return (
            f"{output} is {mean:.6g} in every run but for its last digits: no factor of the study "
            "moves it, or by so little that it has to be given without what is always the same."
        )
    return f"{output} is {mean:.6g} in every run: no factor of the study moves it."


def _failed(snapshot: Mapping[str, Any]) -> str:
    """Return where to look when runs failed; empty if all succeeded."""
    return "" if set(snapshot["evaluations"]) == {"ok"} else "See why its runs failed."


def _doubt(trust: Mapping[str, Any], rows: int) -> str:
    """Return why narrow intervals are not enough to stop at; empty if they are."""
    if rows < FEWEST_ROWS:
        return f"No study of fewer than {FEWEST_ROWS} rows has reached its target."
    return "" if trust.get("trusted", True) else str(trust["sentence"])


def _half(entry: Mapping[str, float]) -> float:
    return 0.5 * (entry["high"] - entry["low"])


def _more_rows(complete: int, times_wider: float) -> int:
    """Return how many rows are needed besides those there are, `MOST_FORECAST` at most."""
    # Before it is squared: half a width of 1e100 by a target of 1e-100 has no square.
    rows = complete * (min(times_wider, float(MOST_FORECAST)) ** 2 - 1.0)
    return _round_up(rows) if rows < MOST_FORECAST else MOST_FORECAST


def _round_up(rows: float) -> int:
    """Round up to two digits: a forecast has no more."""
    unit = 10 ** max(floor(log10(rows)) - 1, 0) if rows >= 1.0 else 1
    return ceil(round(rows / unit, 6)) * unit
