"""What a campaign decides, from its plan and from snapshots alone.

Phase 1 is the elementary effects test of the paper's section 3.1, phase 2 the variance-based
analysis of section 3.2 with the least influential factor fixed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rehyb.campaign.plans import Plan
from rehyb.client import Json
from rehyb.client.states import StudyState
from rehyb.errors import CampaignError, refusing

if TYPE_CHECKING:
    from analysis.sensitivity.judgement.stopping import Step


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One of a campaign's two studies."""

    number: int
    title: str
    #: As `Client.submit` takes it.
    study: Json


@dataclass(frozen=True, kw_only=True)
class Proposed:
    """What phase 1 proposes to fix, for somebody to agree to or not."""

    factor: str
    #: The value it would keep, with its unit.
    value: str
    #: One or two sentences with the numbers.
    evidence: str
    #: Whether the interval separates the factor from the influential ones.
    separated: bool
    #: Every factor that may be fixed instead, the least influential first.
    factors: tuple[str, ...]
    snapshot: Json


def screening_phase(plan: Plan) -> Phase:
    """Return phase 1: all factors of the model."""
    design = {
        "method": "morris",
        "rows": plan.screening_rows,
        "fixed": _kept(plan),
        "factors": _sampled(plan, _kept(plan)),
    }
    return _phase(1, "screening (elementary effects)", plan, design)


def variance_phase(plan: Plan, fixed: str) -> Phase:
    """Return phase 2: the other factors, with `fixed` at its nominal value."""
    model = plan.description
    title = f"variance (Sobol indices), {fixed} fixed at {nominal_value(plan, fixed)}"
    kept = {**_kept(plan), fixed: model.factor(fixed).nominal}
    design = {
        "method": "saltelli",
        "rows": plan.variance_rows,
        "fixed": kept,
        "factors": _sampled(plan, kept),
    }
    return _phase(2, title, plan, design)


def _kept(plan: Plan) -> dict[str, float]:
    """Return what keeps one value throughout: what is fixed, and lengths without a range."""
    single = {n: low for n, (low, high) in _ranges(plan).items() if low == high}
    return {**single, **plan.fixed}


def _ranges(plan: Plan) -> dict[str, tuple[float, float]]:
    """Return the ranges that differ from the model's own; another's arm has none of ours."""
    from sim.parameters.wearer import RANGES

    names = {factor.name for factor in plan.description.factors}
    if plan.described is not None:
        return {}
    return {name: ends for name, ends in RANGES[plan.ranges].items() if name in names}


def _sampled(plan: Plan, kept: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the model's other sampled factors with their ranges."""
    ranges = _ranges(plan)
    return [
        {
            "name": factor.name,
            "range": list(ranges.get(factor.name, (factor.low, factor.high))),
        }
        for factor in plan.description.sampled
        if factor.name not in kept
    ]


def _phase(number: int, title: str, plan: Plan, design: Mapping[str, Any]) -> Phase:
    study = {
        "name": f"phase {number}: {title}",
        "model": plan.model,
        "sampling": plan.sampling,
        "seed": plan.seed,
        **design,
    }
    if plan.outside_range:
        study["outside_range"] = True
    return Phase(number=number, title=title, study=study)


def nominal_value(plan: Plan, factor: str) -> str:
    """Return a factor's nominal value with its unit."""
    found = plan.description.factor(factor)
    return f"{found.nominal:g}" + ("" if found.unit == "1" else f" {found.unit}")


def standing(progress: Json, snapshot: Json) -> tuple[bool, str]:
    """Return whether a study's indices are final, and else what is waited for, if not for results.

    Raises:
        CampaignError: the study was cancelled.
    """
    if progress["state"] == StudyState.CANCELLED:
        raise CampaignError(f"study {progress['study']} was cancelled before it was complete")
    if progress["state"] != StudyState.COMPLETE:
        # Why nobody works on it stands in the progress, if it is known.
        told = progress["workers"] or progress.get("why_it_waits")
        return False, "" if told else "waiting for a worker"
    if snapshot["rows_complete"] < progress["rows"]:
        return False, (
            f"all results are in; the analysis has seen {snapshot['rows_complete']} "
            f"of {progress['rows']} rows"
        )
    return True, ""


def next_step(plan: Plan, phase: Phase, snapshot: Json, rows: int) -> "Step | None":
    """Return what a complete phase does next; None if it has no precision goal.

    Raises:
        Invalid: the goal is none.
    """
    from analysis.sensitivity.judgement.stopping import Goal
    from analysis.sensitivity.judgement.stopping import next_step as judge

    if phase.number == 1 or plan.most_rows is None:
        return None
    goal = Goal(output=plan.output, target=plan.target, up_to=plan.most_rows)
    with refusing(ValueError):
        return judge(snapshot, goal, rows)


def propose(plan: Plan, snapshot: Json) -> Proposed | None:
    """Return what phase 1 proposes to fix; None if too few instances succeeded to rank anything."""
    from analysis.sensitivity.judgement.screening import least_influential, propose_fixing

    proposal = propose_fixing(snapshot, plan.output)
    factor = proposal.factor or least_influential(snapshot, plan.output)
    if factor is None:
        return None
    evidence = proposal.evidence
    if proposal.factor is None:
        evidence += (
            " That does not settle it; as the paper does, phase 2 fixes the least influential "
            f"factor all the same: {factor}."
        )
    return Proposed(
        factor=factor,
        value=nominal_value(plan, factor),
        evidence=evidence,
        separated=proposal.factor is not None,
        factors=tuple(line["factor"] for line in proposal.table),
        snapshot=snapshot,
    )


def decided(proposed: Proposed, agreed: str) -> Json:
    """Return the decision to fix `agreed`, as a campaign's manifest keeps it."""
    as_proposed = agreed == proposed.factor
    asked = "" if as_proposed else f" Asked, the user fixed {agreed} instead."
    return {
        "fixed": agreed,
        "separated": as_proposed and proposed.separated,
        "evidence": proposed.evidence + asked,
    }
