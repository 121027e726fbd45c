"""Which factors do too little to matter, and which of them may be fixed (paper, section 3.1).

A factor of no influence has mu* and ST of exactly 0 here, because both are made of differences
within a row; so has a dummy factor (Khorashadi Zadeh et al. 2017), and a threshold taken from one
would call every other factor influential. Screening therefore compares intervals with a threshold
of what matters, as Sarrazin et al. 2016 do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf
from typing import Any

from analysis.designs import family
from analysis.sensitivity.judgement.ranking import RANKED_BY
from analysis.sensitivity.judgement.trust import FEWEST_ROWS, FEWEST_STILL_ROWS
from analysis.sensitivity.records import output_of

#: Of the largest mu*, and of the variance: a factor that surely does less is not influential.
SHARE_OF_LARGEST = 0.1
SHARE_OF_VARIANCE = 0.05

#: What a factor of no influence has of either index, and a dummy factor with it.
DUMMY = 0.0


@dataclass(frozen=True, kw_only=True)
class Influence:
    """Which factors matter to an output, as far as their intervals tell."""

    #: "mu_star" or "total_order".
    by: str
    #: What the index is compared with; None before there is an index.
    threshold: float | None
    #: What a factor of no influence has of the index.
    dummy: float = DUMMY
    #: Whole interval above, below, or on both sides of it; factors without one are undecided.
    influential: tuple[str, ...]
    non_influential: tuple[str, ...]
    undecided: tuple[str, ...]


def influence(
    factors: Mapping[str, Any], method: str, *, trusted: bool, hidden: bool = False
) -> Influence:
    """Sort factors by whether they matter (Sarrazin et al. 2016, section 2.2).

    None is called non-influential where the sample was not enough to tell, nor one that moved
    nothing at all in fewer than `FEWEST_STILL_ROWS` rows: a rare event looks like that. Nor one
    that runs may hide which fail where factors say so, going by the worst of these.

    Args:
        factors: of an output of a snapshot.
        trusted: whether its intervals can be (`analysis.sensitivity.judgement.trust`).
        hidden: whether failures depend on the factors (`analysis.sensitivity.judgement.failures`).
        method: of the study. The threshold is `SHARE_OF_LARGEST` of the largest mu* or
            `SHARE_OF_VARIANCE` of ST.
    """
    by = RANKED_BY[family(method)]
    known = {name: f[by] for name, f in factors.items() if None not in f[by].values()}
    values = [f[by]["value"] for f in factors.values() if f[by]["value"] is not None]
    threshold: float | None = None
    if values:
        share = SHARE_OF_LARGEST * max(values)
        threshold = share if family(method) == "morris" else SHARE_OF_VARIANCE
    limit = inf if threshold is None else threshold
    # Where no factor does anything, all of them are below what matters.
    below = [
        name
        for name, i in known.items()
        if trusted
        and (i["high"] < limit or i["high"] == DUMMY)
        and (i["high"] > DUMMY or factors[name]["n"] >= FEWEST_STILL_ROWS)
        and (not hidden or _at_worst(factors[name], by) < limit)
    ]
    above = [name for name, i in known.items() if i["low"] >= limit and name not in below]
    return Influence(
        by=by,
        threshold=threshold,
        influential=tuple(above),
        non_influential=tuple(below),
        undecided=tuple(name for name in factors if name not in (*below, *above)),
    )


def _at_worst(factor: Mapping[str, Any], by: str) -> float:
    """Return how large an index may be whatever the failed runs would have said."""
    bounds = (factor.get("worst_case") or {}).get(by) or {}
    high = bounds.get("high")
    return inf if high is None else float(high)


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """What to fix, and why."""

    #: The factor that may be fixed at its nominal value; None if the evidence does not allow it.
    factor: str | None
    #: One or two sentences with the numbers that decided.
    evidence: str
    #: Every factor with "factor", "mu_star", "mu_star_low", "mu_star_high", "sigma", "distance"
    #: (from the origin of the mu*-sigma plane) and "n", the least influential first; a factor
    #: without an estimate comes last, with null.
    table: list[dict[str, Any]]


def propose_fixing(
    snapshot: Mapping[str, Any], output: str, share: float = SHARE_OF_LARGEST
) -> Proposal:
    """Say whether the least influential factor may be fixed (paper, section 3.1).

    It may if the upper confidence limit of its mu* is below `share` of the largest mu*: then, on
    average, it moves `output` by less than that share of what the most influential factor does.

    Raises:
        ValueError: the snapshot is not one of a screening, or has no such output.
    """
    table = _influence(snapshot, output)
    unknown = [entry for entry in table if entry["distance"] is None]
    if unknown:
        evidence = (
            f"Nothing can be fixed yet: {unknown[0]['factor']} has {unknown[0]['n']} elementary "
            f"effects on {output}, and an interval needs at least four."
        )
        return Proposal(factor=None, evidence=evidence, table=table)
    least = table[0]
    largest = max(table, key=lambda entry: float(entry["mu_star"]))
    limit = share * largest["mu_star"]
    below = least["mu_star_high"] < limit
    enough = least["n"] >= (FEWEST_ROWS if least["mu_star_high"] > DUMMY else FEWEST_STILL_ROWS)
    negligible = enough and below
    evidence = (
        f"Over {least['n']} elementary effects, {least['factor']} has the least influence on "
        f"{output}: mu* {least['mu_star']:.3g} ({100 * snapshot['level']:.0f} % interval "
        f"{least['mu_star_low']:.3g} to {least['mu_star_high']:.3g}), sigma {least['sigma']:.3g}. "
        f"The upper limit is {'below' if below else 'not below'} {limit:.3g}, "
        f"{100 * share:g} % of the largest mu* ({largest['factor']}, {largest['mu_star']:.3g})."
    )
    if not enough:
        evidence += f" {least['n']} rows are too few to call a factor non-influential."
    return Proposal(factor=least["factor"] if negligible else None, evidence=evidence, table=table)


def least_influential(snapshot: Mapping[str, Any], output: str) -> str | None:
    """Return the factor closest to the origin of the mu*-sigma plane (paper, figure 8), or None.

    None before any estimate.

    Raises:
        ValueError: as `propose_fixing`.
    """
    first = _influence(snapshot, output)[0]
    return None if first["distance"] is None else str(first["factor"])


def _influence(snapshot: Mapping[str, Any], output: str) -> list[dict[str, Any]]:
    """Return `Proposal.table`."""
    if snapshot["method"] != "morris":
        raise ValueError(f"screening needs a study of method morris, not {snapshot['method']}")
    table: list[dict[str, Any]] = []
    for factor, indices in output_of(snapshot, output)["factors"].items():
        mu_star, sigma = indices["mu_star"], indices["sigma"]["value"]
        known_at_all = None not in (*mu_star.values(), sigma)
        table.append(
            {
                "factor": factor,
                "mu_star": mu_star["value"],
                "mu_star_low": mu_star["low"],
                "mu_star_high": mu_star["high"],
                "sigma": sigma,
                "distance": hypot(mu_star["value"], sigma) if known_at_all else None,
                "n": indices["n"],
            }
        )
    return sorted(table, key=lambda e: inf if e["distance"] is None else float(e["distance"]))
