"""Trace the residual of a robot's joints as identification does: the ordinary before the rare.

1. Of every joint offset, viscous and Coulomb friction and the motor's inertia, together.
2. What joints share: wrong zeros, then a payload on one link, or the inertial parameters of all
   links as one block (Swevers, Verdonck and De Schutter 2007 identify them and the friction at
   once). Before it a gain or a delay explains most of what wrong links do, after it next to none.
3. Springs and play, of all torques at once: each shakes the other joints, and what these share may
   stand for it. Beside them 1 and 2 are asked again.
4. Only then, joint by joint, every other effect. Beside those, 1 to 3 are asked again: a ripple of
   twenty times the noise hides which link carries a load, and what else rubs.

A gain then takes the place of what ordinary effects only imitate, and links other than declared are
kept only if nothing simpler predicts nearly as well.
What left-out groups do not miss goes, after each step. Joints are weighed by what is left of them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.agreed import (
    SHARED,
    missed,
    missed_elsewhere,
    shared_by_joints,
    sure,
)
from analysis.closeloop.identification.arms.gains import alike, with_gains
from analysis.closeloop.identification.arms.hidden import beside_friction
from analysis.closeloop.identification.arms.links import Links, freed_links, links_of
from analysis.closeloop.identification.arms.loose import settled_loose, with_loose
from analysis.closeloop.identification.arms.motors import with_other_joints
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.shared import with_heavier_link, with_share
from analysis.closeloop.identification.arms.whole_fit import WholeFit, with_links
from analysis.closeloop.identification.arms.zeros import (
    ZERO,
    beside_load,
    for_links,
    for_offsets,
    for_rare,
    with_zeros,
    without_needless_zeros,
)
from analysis.closeloop.identification.balance.declared import (
    hung_again,
    placed,
)
from analysis.closeloop.identification.balance.luck import MIN_LATER_GAIN
from analysis.closeloop.identification.balance.model import Model, evaluate, one_joint
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    compare,
)
from analysis.closeloop.identification.balance.sticking import sliding
from analysis.closeloop.identification.candidates import (
    candidates,
    refined,
)
from analysis.closeloop.identification.findings import Grown, Option, Step, standing
from analysis.closeloop.identification.friction.plain_friction import (
    with_peaked_friction,
    with_plain_friction,
)
from analysis.closeloop.identification.growing.friction_laws import with_wound_laws
from analysis.closeloop.identification.growing.steps import grow
from analysis.closeloop.identification.guessed import guessed_damping
from analysis.closeloop.identification.presliding import only_presliding
from sim.effects.laws.loose_link import LooseLink


def traced_robot(
    declared: Model, rows: Rows, progress: Callable[[str], None], *, links_free: bool = True
) -> Grown:
    """Find what the declared model of a robot lacks.

    Args:
        declared: the model as declared.
        rows: samples of all joints, weighed by what is left of each (`weighed`).
        progress: is told what is done.
        links_free: whether links other than declared may be found.
    """
    grown = _traced(declared, rows, progress, links_free=links_free)
    if grown.model.given is not None:
        alone = _traced(declared, rows, as_declared(progress), links_free=False)
        grown = grown if _needed(grown, alone, rows) else alone
    model = with_heavier_link(grown.model, rows)
    if model is grown.model:
        return grown
    return _grown(placed(model, rows), rows, {step.key: step for step in grown.steps})


def as_declared(progress: Callable[[str], None]) -> Callable[[str], None]:
    """Return what tells of a search with the links as they are declared."""
    return lambda what: progress(f"{what}, with the links as they are declared")


def _needed(linked: Grown, alone: Grown, rows: Rows) -> bool:
    """Whether other links than declared predict better than other effects do without them.

    Ten parameters a link imitate others so well that these are not asked for any more. As where
    they stand for a payload, they have to take a good deal more. (Set on tuning seeds 12002 and
    12004 of the unkind bench.)
    """
    worse, better = alone.score.losses, linked.score.losses
    gain, error = compare(worse, better)
    if len(alone.model.effects) > len(linked.model.effects):
        return gain > -error
    return gain > MIN_LATER_GAIN * alone.score.loss and sure(worse, better, rows.fold_of_block)


def _traced(
    declared: Model, rows: Rows, progress: Callable[[str], None], *, links_free: bool
) -> Grown:
    """Trace with the inertial parameters of all links free, or as they are declared."""
    links = links_of(declared.recording)
    model = with_ordinary(declared, rows)
    progress("what the joints share")
    model = _with_shared(model, rows, links, links_free=links_free)
    model = hung_again(model, rows)
    progress("friction and inertia of every joint")
    model = with_gains(without_presliding(pruned(model, rows, links), rows), rows)
    model = for_offsets(model, rows)

    def shared_again(model: Model) -> Model:
        bare = with_ordinary(model.keeping(lambda c: c.effect.name not in SHARED), rows)
        again = pruned(_with_shared(bare, rows, links, links_free=links_free), rows, links)
        again, model = with_gains(again, rows), pruned(model, rows, links)
        gain, error = compare(evaluate(model, rows).losses, evaluate(again, rows).losses)
        better = gain > error or (gain > -error and len(again.effects) < len(model.effects))
        return again if better else model

    progress("what is loose")
    model, found = with_loose(model, rows)
    if found:
        model = settled_loose(shared_again(model), rows)
    for number, joint in enumerate(rows.joints, start=1):
        name = declared.recording.name(joint)
        progress(f"{name}: what else (joint {number} of {len(rows.joints)})")
        model, steps = with_rare(model, rows, joint)
        found |= steps
    model, steps = with_loose(model, rows)
    found |= steps
    # A spring of another joint hides that a zero does better than an offset.
    model = for_offsets(for_rare(model, rows, found.keys()), rows)
    model = with_other_joints(model, rows)
    model = with_peaked_friction(model, rows)
    if found:
        progress("all joints together")
        model = settled_loose(shared_again(model), rows)
    model = without_needless_zeros(model, rows)
    return _grown(placed(with_plain_friction(model, rows), rows), rows, found)


def with_ordinary_again(grown: Grown, rows: Rows) -> Grown:
    """Ask every joint once more for what is ordinary, where something fell that stood for it.

    Args:
        grown: what is left.
        rows: the samples that are fitted.
    """
    links = links_of(rows.recording)
    model = pruned(with_ordinary(grown.model, rows), rows, links)
    model = placed(without_presliding(model, rows), rows)
    again = _grown(model, rows, {step.key: step for step in grown.steps})
    gain, error = compare(grown.score.losses, again.score.losses)
    return again if gain > error else grown


def _with_shared(model: Model, rows: Rows, links: Links, *, links_free: bool) -> Model:
    """Add what joints share: wrong zeros, then a payload or other links, or both for the last."""
    model = with_share(with_zeros(model, rows, links), rows, links, links_free=links_free)
    return beside_load(for_links(model, rows, links), rows)


def weighed(declared: Model, rows: Rows) -> Rows:
    """Return the rows with every joint weighed by what ordinary friction and free links leave.

    Without those in which it sticks.
    """
    return weighed_by(with_ordinary(declared, rows), rows)


def weighed_by(model: Model, rows: Rows) -> Rows:
    """Return the rows weighed by what a model with ordinary friction and free links leave."""
    links = links_of(model.recording)
    fit = WholeFit(model, rows, links)
    rows = sliding(model, rows, fit.with_links(range(len(model.terms))).left / rows.weight)
    for _ in range(2):
        fit = WholeFit(model, rows, links)
        left = fit.with_links(range(len(model.terms)))
        rows = rows.reweighted(rows.left_by_joint(left.losses))
    return rows


def pruned(model: Model, rows: Rows, links: Links) -> Model:
    """Take out the effects that left-out groups do not miss; links are fitted anew each time.

    Of every joint the least missed goes first, and then the others are asked again.
    """
    free, links = model.given is not None, freed_links(model, links)
    guessed = guessed_damping(model.recording)
    fit = WholeFit(replace(model, given=None), rows, links)
    scored = fit.with_links if free else fit.alone
    kept = list(range(len(model.terms)))
    whole = scored(kept)
    for number, term in enumerate(model.terms):
        # A wrong zero that was found before the links may stand for a centre of mass.
        if free and term.candidate is not None and term.candidate.effect is ZERO:
            without = scored([other for other in kept if other != number])
            if not shared_by_joints(without, whole, rows):
                kept.remove(number)
                whole = without
    # Effects are asked for in what the best fit so far leaves: each of many may take a little.
    best = whole
    while True:
        weakest: dict[int, tuple[float, int]] = {}
        for number in kept:
            term = model.terms[number]
            if term.candidate is None or term.candidate.effect.name in SHARED:
                continue
            # What is declared there is no null that trials have to speak against.
            if term.candidate.effect.name == "viscous_friction" and term.joint in guessed:
                continue
            without = scored([other for other in kept if other != number])
            # What is loose shakes every joint.
            loose = isinstance(term.candidate.effect, LooseLink)
            if loose and sure(without.losses, best.losses, rows.fold_of_block):
                continue
            share = missed(without, best, term.joint, rows, name=term.candidate.effect.name)
            if share is None or (free and missed_elsewhere(without, best, term.joint, rows)):
                continue
            if share < weakest.get(term.joint, (np.inf,))[0]:
                weakest[term.joint] = share, number
        if not weakest:
            break
        gone = {number for _, number in weakest.values()}
        whole = scored([number for number in kept if number not in gone])
        if free and any(missed(whole, best, joint, rows) is None for joint in rows.joints):
            # Links stand for what one joint lacks, and not for what all lack at once.
            gone = {min(weakest.values())[1]}
            whole = scored([number for number in kept if number not in gone])
        kept = [number for number in kept if number not in gone]
        best = min(best, whole, key=lambda fitted: fitted.loss)
    model = replace(model, terms=tuple(model.terms[number] for number in kept))
    return placed(with_links(model, links, whole.links) if free else model, rows)


def without_presliding(model: Model, rows: Rows) -> Model:
    """Take out inertia that only corrects how friction passes through zero."""
    coefficients = evaluate(model, rows).coefficients
    for candidate in model.effects:
        if candidate.effect.name != "added_inertia":
            continue
        alone = one_joint(model, coefficients, candidate.joint)
        rest = alone.without(candidate)
        if only_presliding(candidate, alone, rest, rows.of_joint(candidate.joint)):
            model = model.without(candidate)
    return model


def with_rare(model: Model, rows: Rows, joint: int) -> tuple[Model, dict[tuple[str, int], Step]]:
    """Add to one joint whatever else of the catalogue it has, beside what is there.

    What is new also as steps.
    """
    alone = one_joint(model, evaluate(model, rows).coefficients, joint)
    own = rows.of_joint(joint)
    alone = _sharpened(alone, own)
    score = evaluate(alone, own)
    bare = evaluate(alone.keeping(lambda _: False), own)
    there = standing(alone, score)
    # What joints share, or feel of each other, is not asked of one of them. What is ordinary is: a
    # richer form, or a rare one, would stand for what had nothing to show before the rare was
    # found.
    known = {candidate.key for candidate in model.effects}
    known -= {candidate.key for candidate in alone.effects}
    tried = [
        c
        for c in candidates(own.recording)
        if not (c.effect.name in SHARED or isinstance(c.effect, LooseLink) or c.key in known)
    ]

    def more(begun: Grown) -> Grown:
        return grow(begun, own, bare, lambda _: None, tried)[0]

    grown = beside_friction(more(Grown(alone, score, there)), own, more)
    grown = with_wound_laws(grown, own)
    model = replace(
        model,
        terms=(*(t for t in model.terms if set(t.columns) != {joint}), *grown.model.terms),
        channels=(*model.channels, *grown.model.channels),
    )
    stands = {step.key for step in there}
    return model, {step.key: step for step in grown.steps if step.key not in stands}


def _sharpened(model: Model, rows: Rows) -> Model:
    """Refine the non-linear parameters of one joint's effects: how friction turns at rest."""
    for candidate in model.effects:
        if candidate.effect.nonlinear:
            score = evaluate(model, rows)
            option = Option(candidate=candidate, model=model, score=score, gain=0.0, z=0.0)
            model, _ = refined(option, rows)
    return model


def _step(taken: Option, before: float) -> Step:
    return Step(taken=taken, equals=(), options=(), before=before)


def _grown(model: Model, rows: Rows, rare: Mapping[tuple[str, int], Step]) -> Grown:
    score = evaluate(model, rows)
    return Grown(model, score, tuple(_steps(model, rows, score, rare)))


def _steps(
    model: Model, rows: Rows, score: Score, rare: Mapping[tuple[str, int], Step]
) -> Iterator[Step]:
    """Yield a step for every effect: what its joint loses without it (all joints, if shared)."""
    for candidate in model.effects:
        rest = model.without(candidate)
        without = evaluate(rest, rows)
        own = rows.joint_of_block == candidate.joint
        if candidate.effect.name in SHARED:
            own = np.ones(len(own), dtype=bool)
        gain, error = compare(without.losses[own], score.losses[own])
        option = Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)
        before = float(without.losses[own].sum())
        found = rare.get(candidate.key, _step(option, before))
        equals = {
            other.candidate.key: other for other in (*found.equals, *alike(option, rest, rows))
        }
        yield replace(found, taken=option, before=before, equals=tuple(equals.values()))
