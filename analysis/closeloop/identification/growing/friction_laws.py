"""Which law of friction it is, asked where friction may wind up before it slides.

Laws are told from each other by what friction does when slow, and there every one of them turns
with the velocity while true friction winds up first. A law with more freedom makes up for that: it
goes by the position, or differs between directions. And a peak at low speed (Stribeck) is not seen
at all. So once friction has been found its laws are compared again, each free to wind up over
presliding's way (`presliding.free_winding`) unless it predicts better as it turns, and the simplest
of those that predict left-out rows as well as the best is taken. (Where rows about a turn are left
out that freedom fits noise: of an opponent's arm a right law then lost twenty times as much.)
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.luck import (
    LARGE_GAIN,
    MIN_GAIN,
    least_gain,
    more_than_luck,
    predicts_as_well,
)
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_of,
    evaluate,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, Score, compare
from analysis.closeloop.identification.balance.terms import Candidate, kept_columns
from analysis.closeloop.identification.candidates import has_ground
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.nameable import beyond_physics, with_law
from analysis.closeloop.identification.presliding import TURNS, winding_freely
from analysis.closeloop.session.signals import rms
from sim.effects.catalogue import EFFECTS
from sim.effects.motion import RecordedJoint


def with_wound_laws(grown: Grown, rows: Rows) -> Grown:
    """Return what was found, with the law of every joint's friction chosen where it may wind up.

    What winds up as an effect of its own is left out where a law alone does as well. Beside
    friction that is declared a law is a difference, and stays as it was found.
    """
    for joint in {step.taken.candidate.joint for step in grown.steps}:
        own = [s for s in grown.steps if s.taken.candidate.joint == joint]
        own = [s for s in own if s.taken.candidate.effect.rubs]
        sliding = [s for s in own if not s.taken.candidate.effect.winds]
        rest = grown.model
        for step in own:
            rest = rest.without(step.taken.candidate)
        declared = rest.recording.device.friction[joint] or any(
            term.rubs and term.joint == joint for term in rest.terms
        )
        if len(sliding) == 1 and not declared:
            grown = _chosen_again(grown, rest, sliding[0], own, rows)
    return grown


def _chosen_again(grown: Grown, rest: Model, step: Step, own: list[Step], rows: Rows) -> Grown:
    """Return what was found with one law in the place of a joint's friction, if it is another."""
    found, turned, current = _turned([grown.model], step.taken.candidate.joint, rows)
    named = sum(s.taken.candidate.effect.complexity for s in own)
    joint = _bare(grown, step.taken.candidate.joint)
    laws = list(_laws(rest, step.taken.candidate, rows, joint))
    if not laws:
        return grown
    best = min(laws, key=lambda law: law.score.loss)
    as_good = [law for law in laws if predicts_as_well(law.score, best.score)]
    taken = min(as_good, key=lambda law: (law.candidate.effect.complexity, law.score.loss))
    if [s.key for s in own] == [taken.candidate.key]:
        return grown
    if taken.candidate.effect.complexity < named:
        # What predicts better as it turns needs no freedom to wind up, which is simpler than none.
        # (The unkind bench: a peak at low speed was Coulomb friction that winds up in nine ways.)
        plain = turned is found and current.loss < taken.score.loss
        if plain or not predicts_as_well(taken.score, current):
            return grown
    elif not _hidden(taken, grown, [current, *_same(laws, step)], rows):
        return grown
    model = _turning_as_fits(taken, rest, rows, joint)
    score = evaluate(model, rows)
    if beyond_physics(model, score, taken.candidate):
        return grown
    gain, error = compare(evaluate(rest, rows).losses, score.losses)
    again = replace(taken, model=model, score=score, gain=gain, z=gain / error)
    equals = tuple(
        law
        for law in as_good
        if law is not taken
        and not law.candidate.includes(taken.candidate)
        and not taken.candidate.includes(law.candidate)
    )
    new = replace(step, taken=again, equals=equals)
    steps = [new if s is step else s for s in grown.steps if s is step or s not in own]
    return Grown(model, score, tuple(steps))


def _bare(grown: Grown, number: int) -> RecordedJoint:
    """Return a joint with what it was found to take beside friction, which may go with it."""
    coefficients = np.array(grown.score.coefficients)
    for term, part in grown.model.split(coefficients):
        if term.rubs and term.joint == number:
            part[:] = 0.0
    estimate = estimate_of(grown.model, coefficients)
    return RecordedJoint(grown.model.recording, number, estimate)


def _hidden(taken: Option, grown: Grown, others: list[Score], rows: Rows) -> bool:
    """Whether left-out rows miss a richer law beside the turns of what was found.

    Args:
        taken: the richer law, free to wind up or as it turns.
        grown: what was found, as it turns.
        others: scores of that as it turns best, and as one of the laws.
        rows: the samples to fit.
    """
    folds, joint = rows.fold_of_block, taken.candidate.joint
    # What a richer law winds up has more freedom, too: both get it.
    _, model, _ = _turned([taken.model], joint, rows)
    winding, alike = model.terms[len(taken.model.terms) :], grown.model
    for term in winding:
        alike = with_independent(alike, term, rows)
    beside = min([*others, evaluate(alike, rows)], key=lambda score: score.loss)
    gain = beside.loss - taken.score.loss
    # Of a law as it turns, an error of another joint and slow noise leave some, too.
    least = 0.0 if winding else least_gain(rows, joint, beside.losses, taken.score.losses)
    # A form of winding up that is a little wrong leaves something that another law takes. (A
    # quarter, as of peaks, since one of an opponent's arms had a fifth.)
    return (
        _adds(model, taken.score, joint, rows) > MIN_GAIN
        and gain > max(LARGE_GAIN * beside.loss, least)
        # The best of all laws.
        and more_than_luck(beside.losses, taken.score.losses, folds)
    )


def _adds(model: Model, score: Score, joint: int, rows: Rows) -> float:
    """Return what a law adds to its first level over all its friction, in root mean square."""
    first, whole = np.zeros(len(rows.samples[joint])), np.zeros(len(rows.samples[joint]))
    for term, own in model.split(score.coefficients):
        if term.rubs and term.joint == joint:
            torque = kept_columns(term)[joint][rows.samples[joint]] * own
            whole += torque.sum(axis=1)
            first += torque[:, 0]
    return rms(whole - first) / max(rms(whole), 1e-12)


def _same(laws: list[Option], step: Step) -> list[Score]:
    """Return the score of what was found, as one of the laws that turn as fits best."""
    return [law.score for law in laws if law.candidate == step.taken.candidate]


def _laws(rest: Model, found: Candidate, rows: Rows, joint: RecordedJoint) -> Iterator[Option]:
    """Yield every law of friction beside `rest`, free to wind up or not, with its parameters."""
    bare = evaluate(rest, rows)
    present = {found.key, *(candidate.key for candidate in rest.effects)}
    for effect in EFFECTS:
        candidate = Candidate(effect=effect, joint=found.joint)
        if not effect.rubs or effect.winds or not effect.applies(rest.recording, found.joint):
            continue
        if not has_ground(candidate, present):
            continue
        tried = (with_law(rest, candidate, theta, rows, joint) for theta in effect.thetas(joint))
        fitted = [model for model in tried if model is not None]
        if not fitted:
            continue
        model, _, score = _turned(fitted, found.joint, rows)
        gain, error = compare(bare.losses, score.losses)
        yield Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)


def _turned(models: Sequence[Model], joint: int, rows: Rows) -> tuple[Model, Model, Score]:
    """Return the best of one law's fits, and that free to wind up if it predicts better so."""
    best = []
    for free in (True, False):
        tried = [(model, winding_freely(model, joint, rows) if free else model) for model in models]
        scored = [(*fit, evaluate(fit[1], rows)) for fit in tried]
        best.append(min(scored, key=lambda fit: fit[2].sse))
    return min(best, key=lambda fit: fit[2].loss)


def _turning_as_fits(law: Option, rest: Model, rows: Rows, joint: RecordedJoint) -> Model:
    """Return the model with a law that turns over the velocity that fits best without winding."""
    found = [law.model]
    for parameter in (p for p in law.candidate.effect.nonlinear if p.name in TURNS):
        for value in parameter.grid:
            theta = {**law.theta, parameter.name: value}
            model = with_law(rest, law.candidate, theta, rows, joint)
            found += [] if model is None else [model]
    return min(found, key=lambda model: evaluate(model, rows).sse)
