"""What the joints of a robot share: a payload on one link, or other links than declared."""

from dataclasses import replace

from analysis.closeloop.identification.arms.agreed import (
    SHARED,
    better_for_all,
    shared_by_joints,
    sure,
)
from analysis.closeloop.identification.arms.links import Links, links_of
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit, loaded, with_links
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.luck import MIN_GAIN, MIN_LATER_GAIN
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.nameable import with_law
from analysis.closeloop.identification.winding import with_winding
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.drive import AnyGain
from sim.effects.laws.inertia import PlacedPayload

GAIN, ONE_GAIN = AnyGain(), BY_NAME["torque_gain"]
INERTIA = BY_NAME["added_inertia"]


def with_share(model: Model, rows: Rows, links: Links, *, links_free: bool) -> Model:
    """Add a payload or other links than declared, if left-out groups of no joint speak against."""
    fit = WholeFit(model, rows, links)
    every = range(len(model.terms))
    alone, block = fit.alone(every), fit.with_links(every)
    freed = links
    if links_free and sure(alone.losses, block.losses, rows.fold_of_block):
        freed, block = _fewest(model, rows, links, block, fit.strength)
    # Of two links as good, the one that a joint speaks against is not it.
    loads = [load for load in fit.loads() if shared_by_joints(alone, load, rows)]
    best = min(loads, key=lambda load: load.loss, default=None)
    block_wins = links_free and shared_by_joints(alone, block, rows)
    if any(candidate.effect.name in SHARED for candidate in model.effects):
        block_wins = block_wins and alone.loss - block.loss > MIN_LATER_GAIN * alone.loss
    load_wins = best is not None
    if not (block_wins or load_wins):
        return _load_beside_gains(model, rows, links, alone) or model
    # Friction that winds up leaves torque at the ends of movements, as wrong links do.
    wound, _, at = with_winding(model, evaluate(model, rows), rows)
    if at:
        free, every_wound = WholeFit(wound, rows, links), range(len(wound.terms))
        turning = free.alone(every_wound)
        if block_wins:
            wound_block = WholeFit(wound, rows, freed).with_links(every_wound)
            block_wins = shared_by_joints(turning, wound_block, rows)
        if best is not None and best.link is not None and load_wins:
            load_wins = shared_by_joints(turning, free.with_load(every_wound, best.link), rows)
    if best is not None and load_wins:
        further = best.loss - block.loss > MIN_LATER_GAIN * best.loss
        if not (block_wins and further and sure(best.losses, block.losses, rows.fold_of_block)):
            return loaded(model, rows, links, best)
    if not block_wins:
        return model
    return _one_gain(model, rows, links, block) or with_links(model, freed, block.links)


def _fewest(
    model: Model, rows: Rows, links: Links, block: Fitted, strength: float
) -> tuple[Links, Fitted]:
    """Return the links that have to be other than declared, and their fit.

    From the tip inwards each stays as declared if the others predict as well, by one standard error
    (Breiman, Friedman, Olshen and Stone 1984, section 3.4.3). Ten free parameters of a link whose
    declared ones are right cost its joints: three of an opponent's arms with one wrong link were
    refused since the joint behind it lost a twentieth.
    """
    best = block
    for body in reversed(links.bodies):
        fewer = links.only(set(links.bodies) - {body})
        if not fewer.bodies:
            break
        fitted = WholeFit(model, rows, fewer, strength=strength).with_links(range(len(model.terms)))
        lost, error = compare(fitted.losses, best.losses)
        if lost <= error:
            links, block = fewer, fitted
            best = min(best, fitted, key=lambda one: one.loss)
    return links, block


def _one_gain(model: Model, rows: Rows, links: Links, block: Fitted) -> Model | None:
    """Return the model with a gain of every joint, if one for all predicts as well as other links.

    Efforts in another unit, or currents times a wrong factor, are links of that part of their mass:
    by one number instead of ten a link.
    """
    recording = model.recording
    if any((GAIN.name, joint) in model.declared for joint in recording.joints):
        return None
    inverse = {joint: recording.inverse[:, [joint]] for joint in recording.joints}
    one = with_independent(model, Term(joint=recording.joints[0], columns=inverse), rows)
    if one is model:
        return None
    scaled = WholeFit(one, rows, links).alone(range(len(one.terms)))
    lost, error = compare(scaled.losses, block.losses)
    if lost > error:
        return None
    for joint in rows.joints:
        here = Candidate(effect=GAIN, joint=joint)
        with_it = _with_gain(model, rows, here)
        if with_it is model:
            # About an upright axis a gain is inertia: then it is the one that all joints have.
            with_it = _with_gain(model.without(Candidate(effect=INERTIA, joint=joint)), rows, here)
        model = with_it
    return model


def _load_beside_gains(model: Model, rows: Rows, links: Links, alone: Fitted) -> Model | None:
    """Return the model with a load and the gain that hid it, if joints share it beside that.

    What a load adds to a joint whose effort is reported too small may be next to nothing: then that
    joint speaks against the load that the others feel.
    """
    if any(candidate.effect.name in SHARED for candidate in model.effects):
        return None
    gained = model
    for joint in rows.joints:
        gained = _with_gain(gained, rows, Candidate(effect=ONE_GAIN, joint=joint))
    if gained is model:
        return None
    fit, every = WholeFit(gained, rows, links), range(len(gained.terms))
    gains = fit.alone(every)
    best = min(fit.loads(), key=lambda load: load.loss, default=gains)
    further = gains.loss - best.loss > MIN_LATER_GAIN * gains.loss
    if not (further and shared_by_joints(alone, best, rows) and better_for_all(gains, best, rows)):
        return None
    assert best.link is not None
    own = range(len(model.terms))
    found = []
    for beside in [*([*own, number] for number in every[len(own) :]), every]:
        there = replace(gained, terms=tuple(gained.terms[number] for number in beside))
        hung = placed(loaded(there, rows, links, fit.with_load(beside, best.link)), rows)
        found.append((hung, evaluate(hung, rows)))
    # Several gains and a load stand for much else, as for a differential.
    *single, (_, least) = found
    hung, score = min(single, key=lambda one: one[1].loss)
    lost, error = compare(score.losses, least.losses)
    return hung if lost <= error else None


def _with_gain(model: Model, rows: Rows, gain: Candidate) -> Model:
    """Return the model with a gain of one joint, unless its columns explain it."""
    there = model.declared | {candidate.key for candidate in model.effects}
    if gain.key in there or not gain.effect.applies(model.recording, gain.joint):
        return model
    return with_law(model, gain, {}, rows, unfitted(model.recording, gain.joint)) or model


def with_heavier_link(model: Model, rows: Rows) -> Model:
    """Put a link of another mass in the place of a payload on it that predicts little better.

    A link that is heavier throughout is one number, a load up to five; and a gain may stand for
    what the load is not.
    """
    recording = model.recording
    links = links_of(recording)
    before = evaluate(model, rows)
    loads = [c for c in model.effects if isinstance(c.effect, PlacedPayload)]
    without_gains = model.keeping(lambda other: other.effect.name != GAIN.name)
    for load in loads if model.given is None else ():
        body = recording.body(load.joint)
        if body not in links.bodies:
            continue
        link = links.only((body,))
        torque = recording.link_torque(body) @ link.declared[0]
        columns = {joint: torque[:, [joint]] for joint in recording.joints}
        for rest in (without_gains.without(load), model.without(load)):
            heavier = rest.with_term(Term(joint=load.joint, columns=columns, kept=(0,)))
            score = evaluate(heavier, rows)
            lost, error = compare(score.losses, before.losses)
            if lost <= max(error, MIN_GAIN * before.loss):
                return with_links(rest, link, score.coefficients[-1] * link.declared)
    return model
