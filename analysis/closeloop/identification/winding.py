"""Friction that winds up before it slides, beside the effects that were named.

A law of friction that turns with the velocity is ahead of one that winds up first (Dahl 1968). What
that leaves stands at the ends of every movement with the sign of the turn, which is what stiffness
does: K came out 0.2 to 6 % too high. It is no second effect and gets no name
(`presliding.only_presliding`); but events are judged, and limbs fitted, beside it.
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.luck import ALONE_Z, more_than_luck
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, Score, select_rows
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.presliding import winding_freely
from analysis.closeloop.session.signals import rms

NOTE = (
    "friction of {} winds up before it slides: what is fitted beside it allows for that, "
    "model_after.xml does not"
)


def wound_up(found: Trace) -> Trace:
    """Return the trace with friction free to wind up, where left-out rows miss that.

    What is declared and what was found, each in its own model; neither name nor verdict changes.
    """
    declared, before, at = with_winding(found.declared, found.declared_score, found.rows)
    if found.model is found.declared:
        model, score = declared, before
    else:
        model, score, at = with_winding(found.model, found.score, found.rows)
    notes = tuple(NOTE.format(found.rows.recording.name(joint)) for joint in at)
    return replace(
        found,
        declared=declared,
        declared_score=before,
        model=model,
        score=score,
        notes=(*found.notes, *notes),
    )


def with_winding(model: Model, score: Score, rows: Rows) -> tuple[Model, Score, list[int]]:
    """Return the model with its friction free to wind up, its score, and the joints where it is."""
    at = []
    for joint in rows.joints:
        wider = winding_freely(model, joint, rows)
        if wider is model:
            continue
        again = evaluate(wider, rows)
        own = rows.joint_of_block == joint
        worse, better = score.losses[own], again.losses[own]
        real = more_than_luck(worse, better, rows.fold_of_block[own], ALONE_Z)
        if real and _left_in_motion(wider, rows, joint) <= _left_in_motion(model, rows, joint):
            model, score = wider, again
            at.append(joint)
    return model, score, at


def _left_in_motion(model: Model, rows: Rows, joint: int) -> float:
    """Return what a model leaves of a joint in motion, Nm or N, root mean square.

    In rows, too, that no fit has because the joint sticks there: where friction winds up was left
    out of them, and what it does not determine may be anything (five times what is declared left,
    of an opponent's limb).
    """
    moving = select_rows(rows.recording, tuple(np.unique(rows.trial).tolist()))
    left = model.target(moving) - model.base(moving)[0] @ evaluate(model, rows).coefficients
    return rms(left[moving.parts[joint]])
