"""What a coordinator would refuse of a campaign, looked at before anything is started or kept."""

from rehyb.campaign.decisions import Phase, screening_phase, variance_phase
from rehyb.campaign.plans import Plan
from rehyb.errors import Invalid


def check_plan(plan: Plan) -> None:
    """Check both phases of a plan as the coordinator will.

    Raises:
        Invalid: it would refuse one; one sentence.
    """
    from analysis.designs import SAMPLINGS

    if plan.sampling not in SAMPLINGS:
        raise Invalid(f"there is no sampling {plan.sampling!r}: take one of {', '.join(SAMPLINGS)}")
    if plan.most_rows is not None and plan.most_rows < plan.variance_rows:
        raise Invalid(
            f"phase 2 begins with {plan.variance_rows} rows, and --up-to {plan.most_rows} allows "
            "fewer: raise it, or lower --variance-rows"
        )
    first = screening_phase(plan)
    _check_phase(plan, first)
    # Which factor will be fixed nobody knows yet; the phase is the same whichever it is.
    for name in [factor["name"] for factor in first.study["factors"]][:1]:
        _check_phase(plan, variance_phase(plan, name))


def _check_phase(plan: Plan, phase: Phase) -> None:
    from server.errors import InvalidStudyError
    from server.logic.study.plans import FactorChoice, draw_up, refuse_outside_range

    study, model = phase.study, plan.description
    try:
        drawn = draw_up(
            name=study["name"],
            model=model,
            called=plan.model,
            method=study["method"],
            sampling=study["sampling"],
            rows=study["rows"],
            seed=study["seed"],
            factors=[FactorChoice(**factor) for factor in study["factors"]],
            fixed=study["fixed"],
            outputs=None,
        )
        if not plan.outside_range:
            refuse_outside_range(drawn, model, [factor["name"] for factor in study["factors"]])
    except InvalidStudyError as error:
        raise Invalid(f"phase {phase.number} cannot be: {error}") from None
