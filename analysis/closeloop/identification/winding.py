"""Friction that winds up before it slides, beside the effects that were named.

A law of friction that turns with the velocity is ahead of one that winds up first (Dahl 1968). What
that leaves stands at the ends of every movement with the sign of the turn, which is what stiffness
does: K came out 0.2 to 6 % too high. It is no second effect and gets no name
(`presliding.only_presliding`); but events are judged, and limbs fitted, beside it.
"""

from dataclasses import replace

from analysis.closeloop.identification.balance.luck import ALONE_Z, more_than_luck
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, Score
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.presliding import winding_freely

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
        if more_than_luck(worse, better, rows.fold_of_block[own], ALONE_Z):
            model, score = wider, again
            at.append(joint)
    return model, score, at
