"""What the nominal arm lacks by construction: soft tissue and joints that are not aligned.

The nominal model of equation 20 rides rigidly on the robot (q = theta). A real arm lies in soft
tissue, beside the robot's axis, and its muscles' stiffness changes with the angle. That leaves a
residual which candidates imitate: a curve over the angle looks like a hardening spring or a wrong
encoder, tissue and cuffs that rub look like friction of the joint. So on a session
with the nominal model an effect is named only if its torque is larger than what the arm and its
attachment alone are credited with over the plain arms of the full simulation
(`python -m benchmarks.closeloop.patient --plain`, docs/measurements/patient.md), or if it is
friction or a reflex and leaves nothing to explain.
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import kept_columns
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Step, Trace
from analysis.closeloop.identification.nameable import ONE_WAY
from analysis.closeloop.session.contents import NOMINAL

#: Torque of an effect beyond what stiffness, damping and neutral angle absorb, Nm where it acts, up
#: to which soft tissue, misalignment and muscles may be what it imitates.
LIMIT = 2.0
#: ... unless it acts with the direction of the motion and alone explains this share of what is
#: explainable, which cuffs and tissue never do; a curve over the angle they imitate whole.
WHOLE = 0.98
REMARK = (
    "the nominal arm is rigid and aligned with the robot (q = theta): soft tissue, joints that are "
    "not aligned and stiffness that changes with the angle leave a residual like the one that "
    "stays, so it is not put down to friction or any other effect of the joint; record the limb's "
    "own angle (an inertial sensor on the forearm) to see it"
)


def beyond_interface(found: Trace) -> Trace:
    """Withhold names that the rigid, aligned nominal arm alone may explain; others stay.

    Args:
        found: what tracing found; returned as it is unless the session's model is the nominal arm.
    """
    if found.rows.recording.session.model != NOMINAL or found.verdict == Verdict.ADEQUATE:
        return found
    if found.verdict == Verdict.UNEXPLAINED:
        return replace(found, notes=(*found.notes, REMARK))
    if ONE_WAY in found.notes:
        # Too little was recorded to say anything, and the advice is what to record.
        return found
    model, coefficients = found.fit_of_steps
    kept = tuple(
        step
        for number, step in enumerate(found.steps)
        if _exceeds(step, found.declared, model, coefficients, found.rows)
        or (number == 0 and _explains_all(found, step))
    )
    if len(kept) == len(found.steps):
        return found
    if not kept:
        return found.without_names(REMARK)
    keys = {step.key for step in kept}
    reduced = model.keeping(lambda candidate: candidate.key in keys)
    return replace(
        found,
        model=reduced,
        score=evaluate(reduced, found.rows),
        steps=kept,
        explainable_after=explainable(reduced, found.rows),
        notes=(*found.notes, REMARK),
    )


def _exceeds(
    step: Step, declared: Model, model: Model, coefficients: np.ndarray, rows: Rows
) -> bool:
    """Whether an effect's torque is larger than what a plain arm in the device leaves."""
    size = unique_torque(step, declared, model, coefficients, rows)
    return size is None or size > LIMIT


def _explains_all(found: Trace, step: Step) -> bool:
    """Whether one effect of the direction alone leaves nothing that splines could explain."""
    if not step.taken.candidate.effect.directed:
        return False
    left = explainable(step.taken.model, found.rows)
    explained = found.explainable_before.model_loss - left.model_loss
    return explained > WHOLE * (explained + left.remains)


def unique_torque(
    step: Step, declared: Model, model: Model, coefficients: np.ndarray, rows: Rows
) -> float | None:
    """Return an effect's torque beyond what is declared absorbs, Nm; None for a channel.

    The root of its mean square weighted by its own power: the size where it acts, which a catch
    that acts for a moment has as well as friction that always does.
    """
    candidate = step.taken.candidate
    for term, own in model.split(coefficients):
        if term.candidate is None or term.candidate.key != candidate.key:
            continue
        torque = rows.stack(model.transformed(kept_columns(term)), len(term.kept)) @ own
        base, _ = declared.base(rows)
        beyond = torque - base @ np.linalg.lstsq(base, torque, rcond=None)[0]
        power = (beyond / rows.weight) ** 2
        return float(np.sqrt((power**2).sum() / max(float(power.sum()), 1e-300)))
    return None
