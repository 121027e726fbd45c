"""What is loose at a robot's joints, springs and play, asked of the torques of all at once."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from analysis.closeloop.identification.arms.links import freed_links, links_of
from analysis.closeloop.identification.arms.whole_fit import WholeFit, link_rows, with_links
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.luck import MIN_GAIN, more_than_luck
from analysis.closeloop.identification.balance.model import Model, estimate_of, evaluate
from analysis.closeloop.identification.balance.regression import Rows, Score, compare
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.candidates import (
    candidates,
    options_beside,
    tried_alone,
)
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.selection import choose, matters
from analysis.closeloop.identification.springs import ELASTIC, left_by, nearest
from sim.effects.effect import Theta
from sim.effects.laws.loose_link import (
    RESONANCES,
    LooseLink,
    springs_apart,
)
from sim.effects.motion import RecordedJoint

#: Where two links swing against each other each moves the other's frequency by about half of this,
#: the cosine between them in the mass matrix: below, springs are found one by one.
COUPLED = 0.2
#: Where two springs are looked for at once: every other resonance, well damped, so that none falls
#: between. On two arms of three joints what is left has one valley over these.
PAIRED, PAIRED_DAMPING = RESONANCES[::2], 0.2


def with_loose(model: Model, rows: Rows) -> tuple[Model, dict[tuple[str, int], Step]]:
    """Add springs and play, asked of all torques at once; what is new also as steps.

    What is loose at a joint shakes the others, and a payload or other links stand for some of it:
    where it is, and how much of it is theirs, only all joints tell together.
    """
    found: dict[tuple[str, int], Step] = {}
    late: set[int] = set()
    while True:
        current = evaluate(model, rows)
        taken = {c.joint for c in model.effects if isinstance(c.effect, LooseLink)} | late
        tried = [
            c
            for c in candidates(model.recording)
            if isinstance(c.effect, LooseLink) and c.joint not in taken
        ]
        options = options_beside(model, rows, current, tried)
        if model.given is not None:
            options = _beside_free_links(options, rows, current)
        step = choose(options, model, current, rows, MIN_GAIN * current.loss)
        if step is None or step.taken.refused:
            break
        if _rather_late(step.taken, model, rows):
            late.add(step.taken.candidate.joint)
            continue
        model = settled_loose(placed(step.taken.model, rows), rows)
        found[step.key] = step
    model, steps = _with_pair(model, rows)
    return model, found | steps


def _rather_late(option: Option, model: Model, rows: Rows) -> bool:
    """Whether what is late explains more than what is loose at its joint, each alone.

    Where a joint's effort is late it seems to swing. (A stranger's two bare motors: 12 and 4 ms
    left three quarters of what springs did.)
    """
    joint, there = option.candidate.joint, {candidate.key for candidate in model.effects}
    for candidate in candidates(model.recording):
        effect = candidate.effect
        if not (effect.channel and effect.filters and candidate.joint == joint):
            continue
        found = None if candidate.key in there else tried_alone(model, rows, candidate)
        if found is not None and found[1].loss < option.score.loss:
            return True
    return False


def _beside_free_links(options: list[Option], rows: Rows, current: Score) -> list[Option]:
    """Return options with the links fitted anew beside each, best first."""
    found = []
    for option in options:
        model = _linked_anew(option.model, rows)
        score = evaluate(model, rows)
        gain, error = compare(current.losses, score.losses)
        found.append(replace(option, model=model, score=score, gain=gain, z=gain / error))
    return sorted(found, key=lambda option: -option.gain)


def _linked_anew(model: Model, rows: Rows) -> Model:
    """Return the model with other links than declared, if it has any, fitted beside its terms.

    Ten numbers a link stand for most of what a spring does until both are fitted at once (a made
    arm with a last link of 0.78 times its mass).
    """
    if model.given is None:
        return model
    links = freed_links(model, links_of(model.recording))
    rest = replace(model, given=None)
    fitted = WholeFit(rest, rows, links).with_links(range(len(rest.terms)))
    return with_links(rest, links, fitted.links)


def settled_loose(model: Model, rows: Rows) -> Model:
    """Choose the parameters of what is loose again, beside what hangs from it by now.

    Of several springs those of all at once: each swings as the others let it.
    """
    for candidate in model.effects:
        alone = candidate.effect is not ELASTIC or len(_springs(model)) == 1
        if isinstance(candidate.effect, LooseLink) and alone:
            again = tried_alone(model.without(candidate), rows, candidate)
            if again is not None and again[1].loss < evaluate(model, rows).loss:
                model = again[0]
    thetas = _springs(model)
    if not thetas:
        return model
    estimate = estimate_of(model, evaluate(model, rows).coefficients)
    joint = RecordedJoint(model.recording, next(iter(thetas)), estimate)
    left = _left_by(model.keeping(lambda c: c.effect is not ELASTIC), rows, joint)
    # Always anew: others may be gone that each swung beside.
    return _with_springs(model, joint, nearest(left, thetas))


def _springs(model: Model) -> dict[int, Theta]:
    """Return the parameters of the springs that were found, by their joints."""
    springs = (t for t in model.terms if t.candidate and t.candidate.effect is ELASTIC)
    return {term.joint: term.theta for term in springs}


def _with_springs(model: Model, joint: RecordedJoint, thetas: Mapping[int, Theta]) -> Model:
    """Return the model with other springs in the place of its own: each with its part of all."""
    terms = list(model.keeping(lambda c: c.effect is not ELASTIC).terms)
    for number, columns in springs_apart(joint, thetas).items():
        candidate = Candidate(effect=ELASTIC, joint=number)
        terms.append(
            Term(
                joint=number,
                columns=columns,
                lower=ELASTIC.lower,
                theta=thetas[number],
                kept=(0,),
                effect=ELASTIC,
                candidate=candidate,
            )
        )
    return replace(model, terms=tuple(terms))


def _left_by(
    rest: Model, rows: Rows, joint: RecordedJoint
) -> Callable[[Mapping[int, Theta]], np.ndarray]:
    """Return what tells what springs leave, (r,), beside free links if others were found."""
    if rest.given is None:
        return left_by(rest, rows, joint)
    links = freed_links(rest, links_of(rest.recording))
    return left_by(rest, rows, joint, link_rows(rest, rows, links))


def _with_pair(model: Model, rows: Rows) -> tuple[Model, dict[tuple[str, int], Step]]:
    """Add a spring beside one that was found alone, both asked at once; what is new also as steps.

    Links that swing against each other do so at other frequencies than alone: one spring takes most
    of what both do with a wrong stiffness, beside which the other has nothing to show. What else
    was found may stand for the rest, so they are asked in the place of all but friction, too.
    """
    current = evaluate(model, rows)
    bare = replace(model, given=None).keeping(lambda c: c.effect.rubs or c.effect is ELASTIC)
    begun, rests = [], [model] if bare.effects == model.effects else [model, bare]
    for pair in _coupled(model, rows):
        for rest in rests:
            found = _paired(rest, rows, pair)
            if found is not None:
                begun.append((evaluate(found, rows).loss, found, pair))
    if not begun:
        return model, {}
    _, paired, pair = min(begun, key=lambda one: one[0])
    paired = _linked_anew(settled_loose(placed(paired, rows), rows), rows)
    score = evaluate(paired, rows)
    gain, error = compare(current.losses, score.losses)
    # In the place of as many effects they only have to predict better.
    told = gain > error
    if len(paired.effects) > len(model.effects):
        told = more_than_luck(current.losses, score.losses, rows.fold_of_block)
    without = evaluate(paired.keeping(lambda c: c not in pair), rows)
    taken, error = compare(without.losses, score.losses)
    options = [
        Option(candidate=candidate, model=paired, score=score, gain=taken, z=taken / error)
        for candidate in pair
    ]
    matter = all(matters(option, without, rows) for option in options)
    if not (told and matter and _gains(current, score)):
        return model, {}
    steps = [Step(taken=option, equals=(), options=(), before=without.loss) for option in options]
    return paired, {step.key: step for step in steps}


def _gains(before: Score, after: Score) -> bool:
    """Whether a score is better by what changes a number in a report."""
    return before.loss - after.loss > MIN_GAIN * before.loss


def _coupled(model: Model, rows: Rows) -> Iterator[tuple[Candidate, Candidate]]:
    """Yield each spring that is there with one of a joint whose link swings against its own."""
    loose = [c.joint for c in model.effects if isinstance(c.effect, LooseLink)]
    recording = model.recording
    inertia = {joint: recording.inertia(joint) for joint in rows.joints}
    for one, other in product(_springs(model), rows.joints):
        across = np.mean(inertia[one][:, other] ** 2)
        least = COUPLED**2 * np.mean(inertia[one][:, one] * inertia[other][:, other])
        if across > least and other not in loose and ELASTIC.applies(recording, other):
            yield Candidate(effect=ELASTIC, joint=one), Candidate(effect=ELASTIC, joint=other)


def _paired(model: Model, rows: Rows, pair: tuple[Candidate, Candidate]) -> Model | None:
    """Return a model with springs at two joints that fit best, from a coarse grid, or None."""
    rest = model.keeping(lambda c: c not in pair)
    without = evaluate(rest, rows)
    first, second = (candidate.joint for candidate in pair)
    joint = RecordedJoint(rest.recording, first, estimate_of(rest, without.coefficients))
    left = _left_by(rest.keeping(lambda c: c.effect is not ELASTIC), rows, joint)
    others = _springs(rest)
    thetas = [{"resonance": hertz, "damping_ratio": PAIRED_DAMPING} for hertz in PAIRED]
    grid = ({**others, first: one, second: other} for one, other in product(thetas, thetas))
    best = min(grid, key=lambda springs: float(np.sum(left(springs) ** 2)))
    paired = _with_springs(rest, joint, nearest(left, best))
    return paired if _gains(without, evaluate(paired, rows)) else None
