"""What indices of a sample cannot be together, so that something is wrong with its rows.

Shares of independent factors sum to 1 at most (Sobol 1993, Sensitivity estimates for nonlinear
mathematical models).
"""

from collections.abc import Container, Mapping
from itertools import combinations
from typing import Any

from scipy.stats import norm

from analysis.given.measures.measure import MEASURES
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE
from analysis.sensitivity.judgement.trust import CLEARLY_ABOVE_ONE

#: Measures that are shares of the variance, as the first-order index of a design is.
_SHARES = tuple(measure.name for measure in MEASURES if measure.symbol.startswith("S"))
#: How likely one factor or more of an output is said to have two indices, if it has one.
_BY_CHANCE = 1e-3
#: Factors with two shares that are shown.
_SHOWN = 5


def beyond_the_whole(output: str, told: Mapping[str, Any], level: float) -> list[str]:
    """Say so if the factors explain more than there is.

    Args:
        output: its name.
        told: first-order indices of factors that are independent: {NAME: {FACTOR: INTERVAL}}.
        level: of the intervals.
    """
    said = []
    for name, index in told.items():
        # Of many factors that do nothing half have a lower end above 0.
        beyond = _times(len(index), level)
        known = [one for one in index.values() if one["low"] is not None]
        least = sum(one["low"] for one in known if one["value"] > beyond * _half(one, -1.0))
        if least > CLEARLY_ABOVE_ONE:
            said.append(
                f"Do not trust {name} of {output}: the lower ends of its {level:.0%} intervals sum "
                f"to {least:.2f}, and shares of independent factors truly to no more than 1. "
                "Either factors depend on each other, or outputs do not stand beside the points "
                "that they are of."
            )
    return said


def out_of_range(output: str, told: Mapping[str, Any], level: float) -> list[str]:
    """Say so if a factor's share is surely below 0 or above 1, and by what matters.

    Of factors that depend on each other a covariance may be (Li et al. 2010), but it is no part of
    the variance then.

    Args:
        output: its name.
        told: measures of a sample that are shares, {NAME: {FACTOR: INTERVAL}}.
        level: of the intervals.
    """
    said = []
    for name, index in told.items():
        beyond = _times(len(index), level)
        outside = []
        for factor, one in index.items():
            if one["low"] is None:
                continue
            share, within = one["value"], min(max(one["value"], 0.0), 1.0)
            off = share - within
            if abs(off) > max(beyond * _half(one, -off), SHARE_OF_VARIANCE):
                outside.append(f"{factor} {share:.2f}")
        if outside:
            said.append(
                f"Shares of {output} by {name} lie outside 0 to 1 ({', '.join(outside)}): what "
                "factors do that depend on each other cancels. They are no parts of the variance; "
                "give sums and differences of such factors in their stead."
            )
    return said


def two_answers(
    output: str, design: Mapping[str, Any], told: Mapping[str, Any], level: float
) -> list[str]:
    """Say so if a design and its points as a sample tell two shares of one factor.

    And if they differ by what matters (`SHARE_OF_VARIANCE`).

    Args:
        output: its name.
        design: first-order indices of a design, {FACTOR: INTERVAL}.
        told: measures of its points as a sample, {NAME: {FACTOR: INTERVAL}}.
        level: of the intervals.
    """
    beyond = _times(len(design), level)
    found = []
    for name, index in told.items():
        for factor, one in index.items():
            other = design.get(factor, {})
            if None in (one["low"], other.get("low")):
                continue
            apart = other["value"] - one["value"]
            # Half the intervals, each towards the other.
            half = _half(one, apart), _half(other, -apart)
            times = abs(apart) / max((half[0] ** 2 + half[1] ** 2) ** 0.5, 1e-300)
            if times > beyond and abs(apart) > SHARE_OF_VARIANCE:
                said = f"{other['value']:.2f} by the design and {one['value']:.2f} by {name}"
                found.append((times, f"the share of {factor} in {output} is {said}"))
    if not found:
        return []
    return [
        f"Two answers: {max(found)[1]}. Either the output has more waves or jumps than the latter "
        "follows, or outputs do not stand beside the points that they are of."
    ]


def apart(
    output: str,
    told: Mapping[str, Any],
    level: float,
    *,
    tied: Container[str] = (),
    known: Container[str] = (),
) -> list[str]:
    """Say of which factors two measures of the same rows tell two shares, surely.

    Of independent factors both tell S (Sobol 1993), as far as they follow the output. Of others
    they do not, for one deals what factors explain together (Li et al. 2010).

    Args:
        output: its name.
        told: measures of a sample that are shares, {NAME: {FACTOR: INTERVAL}}.
        level: of the intervals.
        tied: factors that depend on others.
        known: factors of which it is said already what the two do not follow.
    """
    said = []
    for (one, index), (two, other) in combinations(told.items(), 2):
        beyond = _times(len(index), level)
        dealt = []
        for factor in index:
            a, b = index[factor], other[factor]
            if factor in known or None in (a["low"], b["low"]):
                continue
            off = b["value"] - a["value"]
            half = (_half(a, off) ** 2 + _half(b, -off) ** 2) ** 0.5
            if abs(off) <= max(beyond * half, SHARE_OF_VARIANCE):
                continue
            both = f"{a['value']:.2f} by {one} and {b['value']:.2f} by {two}"
            if factor in tied:
                dealt.append(f"{factor} {both}")
                continue
            said.append(
                f"Do not trust the share of {factor} in {output}: it is {both}, of the same rows. "
                "Either the output changes with it more often than the one follows that tells less "
                "of it, or factors depend on each other."
            )
        if dealt:
            more = f" and {len(dealt) - _SHOWN} more" if len(dealt) > _SHOWN else ""
            said.append(
                f"Two shares of {output} each: {', '.join(dealt[:_SHOWN])}{more}. These factors "
                "depend on others: rbd_fast counts for one all that goes with it, hdmr deals what "
                "they explain together. Neither is what a factor does by itself."
            )
    return said


def shares(measures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the measures that are shares of the variance."""
    return {name: index for name, index in measures.items() if name in _SHARES}


def _times(factors: int, level: float) -> float:
    """Return how many halves of an interval one of so many factors is off hardly ever by chance."""
    return float(norm.isf(_BY_CHANCE / 2.0 / max(factors, 1)) / norm.isf((1.0 - level) / 2.0))


def _half(interval: Mapping[str, float], towards: float) -> float:
    end = interval["high"] if towards > 0.0 else interval["low"]
    return abs(end - interval["value"])
