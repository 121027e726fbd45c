"""Wrong zeros of encoders: the links are elsewhere than thought, which every joint feels."""

from collections.abc import Collection, Iterator
from dataclasses import replace

import mujoco
import numpy as np

from analysis.closeloop.identification.arms.agreed import better_for_all, shared_by_joints
from analysis.closeloop.identification.arms.links import Links
from analysis.closeloop.identification.arms.whole_fit import WholeFit, loaded
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.luck import MIN_LATER_GAIN, MIN_TORQUE
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, Score, compare
from analysis.closeloop.identification.balance.terms import Candidate, Term, kept_columns
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.nameable import beyond_physics
from analysis.closeloop.session.chain.link_torque import carriers
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.inertia import PlacedPayload
from sim.effects.laws.loose_link import LooseLink

ZERO = BY_NAME["position_offset"]
#: What a zero does where a trial moves one joint and holds the others.
IMITATE = ("torque_offset", "torque_gain", "added_inertia")
#: A zero to begin with, rad or m.
LITTLE = 1e-3


def with_zeros(model: Model, rows: Rows, links: Links) -> Model:
    """Add wrong zeros one at a time, if left-out groups of no joint speak against.

    Before other links are thought of: ten parameters a link do most of what a zero does. A load
    that explains more goes first.
    """
    while True:
        current = evaluate(model, rows)
        found = [(m, s) for m, s in _zeros(model, rows) if shared_by_joints(current, s, rows)]
        if not found:
            return model
        best, score = min(found, key=lambda pair: pair[1].loss)
        loads = WholeFit(model, rows, links).loads()
        if min((load.loss for load in loads), default=score.loss) < score.loss:
            return model
        model = best


def beside_load(model: Model, rows: Rows) -> Model:
    """Add wrong zeros beside a payload that explained more than each of them.

    Gravity tells a zero from where the load hangs by little, and only inertia the rest. So what is
    left without it is less than its torque: that has to matter, and the gain to be that of a later
    effect.
    """
    if not any(term.candidate and isinstance(term.effect, PlacedPayload) for term in model.terms):
        return model
    while True:
        current = evaluate(model, rows)
        least = (1.0 - MIN_LATER_GAIN) * current.loss
        found = [
            (tried, score)
            for tried, score in _zeros(model, rows)
            if score.loss < least
            and better_for_all(current, score, rows)
            and _matters(tried, score, rows)
        ]
        if not found:
            return model
        model, _ = min(found, key=lambda pair: pair[1].loss)


def _matters(model: Model, score: Score, rows: Rows) -> bool:
    """Whether the torque of a model's last term is more than a small part of the effort."""
    *_, (term, own) = model.split(score.coefficients)
    torque = rows.stack(model.transformed(kept_columns(term)), len(term.kept)) @ own
    efforts = sum(rows.effort_power(joint) for joint in rows.samples)
    return bool(torque @ torque > MIN_TORQUE**2 * efforts)


def for_offsets(model: Model, rows: Rows) -> Model:
    """Put one wrong zero in the place of all offsets, gains and inertias, if it predicts as well.

    Where a trial moves one joint, a wrong zero of another is an offset or a gain of the first, and
    beside those it has nothing to show. In the place of a single one it has to predict better.
    """
    gone = [candidate for candidate in model.effects if candidate.effect.name in IMITATE]
    bare = model.keeping(lambda candidate: candidate not in gone)
    found = list(_zeros(bare, rows)) if gone else []
    if not found:
        return model
    best, score = min(found, key=lambda pair: pair[1].loss)
    better, error = compare(evaluate(model, rows).losses, score.losses)
    return best if better > (error if len(gone) == 1 else -error) else model


def for_links(model: Model, rows: Rows, links: Links) -> Model:
    """Put a payload and a wrong zero in the place of other links, if they predict better.

    Neither explains much while the other is missing, and ten parameters a link do most of what
    both do.
    """
    if model.given is None:
        return model
    bare = replace(model, given=None)
    block = WholeFit(bare, rows, links).with_links(range(len(bare.terms)))
    found = list(_loads_and_zeros(bare, rows, links))
    if not found:
        return model
    best, score = min(found, key=lambda pair: pair[1].loss)
    return best if score.loss < block.loss else model


def _loads_and_zeros(model: Model, rows: Rows, links: Links) -> Iterator[tuple[Model, Score]]:
    """Yield the model with a wrong zero of each joint that has none yet, and the best payload.

    A last joint's only turns what hangs there, which other links do exactly: nothing tells them
    apart (a Panda's came out as -0.9 rad, by a fifth of a percent).
    """
    for zero in _missing(model, rows):
        if _is_last(model.recording.device.model, links.bodies, zero.joint):
            continue
        # A little one, which goes to its place beside the load.
        joint, theta = unfitted(model.recording, zero.joint), {"offset": LITTLE}
        columns = ZERO.columns(joint, theta)
        term = Term(effect=ZERO, joint=zero.joint, columns=columns, theta=theta, candidate=zero)
        loads = WholeFit(with_independent(model, term, rows), rows, links).loads()
        if not loads:
            continue
        best = min(loads, key=lambda load: load.loss)
        found = tried_alone(loaded(model, rows, links, best), rows, zero)
        if found is not None:
            beside = placed(found[0], rows)
            yield beside, evaluate(beside, rows)


def _is_last(arm: mujoco.MjModel, bodies: Collection[int], joint: int) -> bool:
    """Whether no joint beyond one carries a link."""
    carried = (carriers(arm, body) for body in bodies)
    return all(joints[0] == joint for joints in carried if joint in joints)


def for_rare(model: Model, rows: Rows, rare: Collection[tuple[str, int]]) -> Model:
    """Put a wrong zero in the place of what is rare at one joint, if left-out groups prefer it.

    Beside nothing a little one gains less than a name has to, and backlash or a coupling of the
    joint that shows it most then stands for it.
    """
    for candidate in model.effects:
        if candidate.key not in rare or candidate.effect.rubs:
            continue
        current, zeros = evaluate(model, rows), _zeros(model.without(candidate), rows)
        found = [(m, s) for m, s in zeros if better_for_all(current, s, rows)]
        if found:
            model, _ = min(found, key=lambda pair: pair[1].loss)
    return model


def without_needless_zeros(model: Model, rows: Rows) -> Model:
    """Take out wrong zeros that joints do not share any more once what is loose was found.

    A link that leans on its spring is elsewhere, too, and a zero stood for what that was not yet.
    And those that would be where none can be, beside all that was found since.
    """
    for candidate in model.effects:
        if candidate.effect is ZERO and beyond_physics(model, evaluate(model, rows), candidate):
            model = placed(model.without(candidate), rows)
    if not any(isinstance(candidate.effect, LooseLink) for candidate in model.effects):
        return model
    for candidate in model.effects:
        if candidate.effect is ZERO:
            rest = model.without(candidate)
            if not shared_by_joints(evaluate(rest, rows), evaluate(model, rows), rows):
                model = rest
    return model


def _zeros(model: Model, rows: Rows) -> Iterator[tuple[Model, Score]]:
    """Yield the model with a wrong zero of each joint that has none yet, if it can be one."""
    tried = [(zero, tried_alone(model, rows, zero)) for zero in _missing(model, rows)]
    found = sorted(((*one, zero) for zero, one in tried if one), key=lambda each: each[1].loss)
    best = np.inf
    for beside, score, zero in found:
        # What loses to one that is in its place already is not worth its own.
        if score.loss < best:
            beside = placed(beside, rows)
            score = evaluate(beside, rows)
            if beyond_physics(beside, score, zero):
                continue
            best = min(best, score.loss)
        yield beside, score


def _missing(model: Model, rows: Rows) -> Iterator[Candidate]:
    """Yield a wrong zero of each joint that has none yet."""
    there = model.declared | {candidate.key for candidate in model.effects}
    for joint in rows.joints:
        zero = Candidate(effect=ZERO, joint=joint)
        if zero.key not in there and ZERO.applies(model.recording, joint):
            yield zero
