"""Factor fixing: which factor a screening study shows to be negligible (paper, section 3.1)."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf
from typing import Any


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


def propose_fixing(snapshot: Mapping[str, Any], output: str, share: float = 0.1) -> Proposal:
    """Say whether the least influential factor may be fixed.

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
            f"effects on {output}, and an interval needs at least two."
        )
        return Proposal(factor=None, evidence=evidence, table=table)
    least = table[0]
    largest = max(table, key=lambda entry: float(entry["mu_star"]))
    limit = share * largest["mu_star"]
    negligible = least["mu_star_high"] < limit
    evidence = (
        f"Over {least['n']} elementary effects, {least['factor']} has the least influence on "
        f"{output}: mu* {least['mu_star']:.3g} ({100 * snapshot['level']:.0f} % interval "
        f"{least['mu_star_low']:.3g} to {least['mu_star_high']:.3g}), sigma {least['sigma']:.3g}. "
        f"The upper limit is {'below' if negligible else 'not below'} {limit:.3g}, "
        f"{100 * share:g} % of the largest mu* ({largest['factor']}, {largest['mu_star']:.3g})."
    )
    return Proposal(factor=least["factor"] if negligible else None, evidence=evidence, table=table)


def least_influential(snapshot: Mapping[str, Any], output: str) -> str | None:
    """Return the factor closest to the origin of the mu*-sigma plane; None before any estimate.

    Raises:
        ValueError: as `propose_fixing`.
    """
    first = _influence(snapshot, output)[0]
    return None if first["distance"] is None else str(first["factor"])


def _influence(snapshot: Mapping[str, Any], output: str) -> list[dict[str, Any]]:
    """Return `Proposal.table`."""
    if snapshot["method"] != "morris":
        raise ValueError(f"screening needs a study of method morris, not {snapshot['method']}")
    if output not in snapshot["outputs"]:
        known = ", ".join(snapshot["outputs"])
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    table: list[dict[str, Any]] = []
    for factor, indices in snapshot["outputs"][output]["factors"].items():
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
