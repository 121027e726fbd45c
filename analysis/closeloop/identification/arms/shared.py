"""What the joints of a robot share: a payload on one link, or other links than declared."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.agreed import SHARED, shared_by_joints, sure
from analysis.closeloop.identification.arms.links import Links
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.luck import MIN_LATER_GAIN
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Given,
    Model,
    Term,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.winding import with_winding
from analysis.closeloop.session.link_torque import carriers
from sim.effects.laws.inertia import PLACE, LinkInertia

LINKS = LinkInertia()


def with_share(model: Model, rows: Rows, links: Links, *, links_free: bool) -> Model:
    """Add a payload or other links than declared, if left-out groups of no joint speak against."""
    fit = WholeFit(model, rows, links)
    every = range(len(model.terms))
    alone, block = fit.alone(every), fit.with_links(every)
    # Of two links as good, the one that a joint speaks against is not it.
    loads = [load for load in fit.loads() if shared_by_joints(alone, load, rows)]
    best = min(loads, key=lambda load: load.loss, default=None)
    block_wins = links_free and shared_by_joints(alone, block, rows)
    if any(candidate.effect.name in SHARED for candidate in model.effects):
        block_wins = block_wins and alone.loss - block.loss > MIN_LATER_GAIN * alone.loss
    load_wins = best is not None
    if not (block_wins or load_wins):
        return model
    # Friction that winds up leaves torque at the ends of movements, as wrong links do.
    wound, _, at = with_winding(model, evaluate(model, rows), rows)
    if at:
        free, every_wound = WholeFit(wound, rows, links), range(len(wound.terms))
        turning = free.alone(every_wound)
        block_wins = block_wins and shared_by_joints(turning, free.with_links(every_wound), rows)
        if best is not None and best.link is not None and load_wins:
            load_wins = shared_by_joints(turning, free.with_load(every_wound, best.link), rows)
    if best is not None and load_wins:
        further = best.loss - block.loss > MIN_LATER_GAIN * best.loss
        if not (block_wins and further and sure(best.losses, block.losses, rows.fold_of_block)):
            return _loaded(model, rows, links, best)
    return with_links(model, links, block.links) if block_wins else model


def _loaded(model: Model, rows: Rows, links: Links, load: Fitted) -> Model:
    """Add the payload of a fit as a term."""
    assert load.link is not None and load.place is not None
    recording = model.recording
    chain = recording.device.model
    joint = carriers(chain, links.bodies[load.link])[0]
    theta = dict(zip(PLACE, load.place.tolist(), strict=True))
    term = Term(
        effect=PLACED,
        joint=joint,
        columns=PLACED.columns(unfitted(recording, joint), theta),
        lower=PLACED.lower,
        theta=theta,
        candidate=Candidate(effect=PLACED, joint=joint),
    )
    *others, hung = with_independent(model, term, rows).terms
    told = (0, *(axis + 1 for axis in load.told))
    kept = tuple(column for column in hung.kept if column in told)
    return replace(model, terms=(*others, replace(hung, kept=kept)))


def with_links(model: Model, links: Links, change: np.ndarray) -> Model:
    """Give the model the links that a fit found."""
    recording = model.recording
    torque = {
        joint: sum(
            (
                recording.link_torque(body)[:, joint] @ own
                for body, own in zip(links.bodies, change, strict=True)
            ),
            start=np.zeros(len(recording.time)),
        )[:, None]
        for joint in recording.joints
    }
    values = dict(zip(links.names, links.declared + change, strict=True))
    candidate = Candidate(effect=LINKS, joint=recording.joints[0])
    return replace(model, given=Given(torque=torque, candidate=candidate, links=values))
