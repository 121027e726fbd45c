"""What the joints of a robot share: a payload on one link, or other links than declared."""

from dataclasses import replace

import numpy as np
from scipy.stats import norm, t

from analysis.closeloop.identification.arms.links import Links
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.luck import LARGE_GAIN, LARGE_Z, MIN_Z, wins_in_folds
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Given,
    Model,
    Term,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import (
    Rows,
    compare,
    rank_z,
    takes_all,
)
from analysis.closeloop.identification.selection import MIN_GAIN, MIN_LATER_GAIN, MIN_TORQUE
from analysis.closeloop.identification.winding import with_winding
from analysis.closeloop.session.link_torque import carriers
from sim.effects.laws.inertia import PLACE, LinkInertia

#: By how much a joint's error may grow, by chance, where joints share something.
WORSE = 0.01
LINKS = LinkInertia()


def with_share(model: Model, rows: Rows, links: Links) -> Model:
    """Add a payload or other links than declared, if left-out groups of no joint speak against."""
    fit = WholeFit(model, rows, links)
    every = range(len(model.terms))
    alone, block = fit.alone(every), fit.with_links(every)
    loads = [fit.with_load(every, number) for number in range(len(links.bodies))]
    loads = [load for load in loads if _plausible(load, model, links)]
    best = min(loads, key=lambda load: load.loss, default=None)
    block_wins = shared_by_joints(alone, block, rows)
    load_wins = best is not None and shared_by_joints(alone, best, rows)
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


def shared_by_joints(alone: Fitted, other: Fitted, rows: Rows) -> bool:
    """Whether something that joints share predicts better, and none of them worse."""
    gain = alone.loss - other.loss
    matters = MIN_TORQUE**2 * sum(rows.effort_power(joint) for joint in rows.samples)
    if gain <= max(MIN_GAIN * alone.loss, matters) or not sure(
        alone.losses, other.losses, rows.fold_of_block
    ):
        return False
    before, after = (np.bincount(rows.joint_of_block, fit.losses) for fit in (alone, other))
    return bool(np.all(after <= (1.0 + WORSE) ** 2 * before))


def sure(worse: np.ndarray, better: np.ndarray, folds: np.ndarray) -> bool:
    """Whether a gain is more than luck; as for other effects, a large one may have fewer errors.

    Args:
        worse: losses of blocks, (blocks,).
        better: the same under the other model.
        folds: number of each block's fold.
    """
    gain, error = compare(worse, better)
    if gain > MIN_Z * error or (gain > LARGE_Z * error and rank_z(worse, better) > MIN_Z):
        return True
    if takes_all(worse, better):
        return True
    return (
        gain > LARGE_GAIN * float(worse.sum())
        and gain > LARGE_Z * error
        and wins_in_folds(worse, better, folds)
    )


def nested_z(without: np.ndarray, beside: np.ndarray, block: np.ndarray) -> float:
    """Return how surely left-out rows show an effect that one of two fits lacks.

    The error that the effect's own estimate brings is no evidence against it, though `compare`
    counts it so: between nested models the difference of squares is that of the residuals times
    what the effect adds, less the square of what it adds (Clark and West 2007, Approximately normal
    tests for equal predictive accuracy in nested models). With few seconds that is half of it; then
    the error is not well known either, and Student's t with as many blocks is asked. (Chosen after
    looking at joint 1 of the Panda.)

    Args:
        without: held-out residuals without the effect, (r,).
        beside: the same with it.
        block: number of each row's block.

    Returns:
        Standard errors of a normal distribution that are as rare.
    """
    shown = np.bincount(block, 2.0 * without * (without - beside))
    gain, error = compare(shown, np.zeros(len(shown)))
    return float(norm.isf(t.sf(gain / error, len(shown) - 1)))


def _plausible(load: Fitted, model: Model, links: Links) -> bool:
    """Whether a load has a mass, and hangs where the arm could reach."""
    assert load.load is not None and load.place is not None and load.link is not None
    recording = model.recording
    joint = carriers(recording.device.model, links.bodies[load.link])[0]
    return bool(load.load[0] > 0.0 and np.linalg.norm(load.place) <= recording.reach(joint))


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
    return with_independent(model, term, rows)


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
