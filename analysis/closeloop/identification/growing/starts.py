"""Other first effects to begin with, where one effect at a time may have begun with a wrong one."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice

from analysis.closeloop.identification.balance.luck import LARGE_GAIN, MIN_LATER_GAIN, MIN_Z
from analysis.closeloop.identification.balance.model import Model, evaluate, impedances
from analysis.closeloop.identification.balance.regression import Rows, Score, compare, rank_z
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import (
    candidates,
    options_beside,
    refined,
    tried_alone,
)
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.growing.steps import grow
from sim.effects.catalogue import BY_NAME

#: Share of what splines can explain of the declared model that has to be left for the next ones to
#: be asked, how many are, and the share of the loss that one of them may leave. (That the gain
#: counts, not how sure it is, was set while looking at a stranger's reflex with a load.)
LEFT, FOREMOST, LEAVES = 0.1, 3, 0.5


def regrown(
    grown: Grown,
    declared: Model,
    rows: Rows,
    before: Score,
    progress: Callable[[str], None] = lambda _: None,
) -> Grown:
    """Return what other first effects lead to, where that predicts better by enough.

    Args:
        grown: what was found one effect at a time.
        declared: the model without effects.
        rows: the samples to fit.
        before: the score of `declared`.
        progress: is told what is done.
    """
    for begun in simpler_starts(grown, rows, before):
        again, _ = grow(begun, rows, before, progress)
        if better(again, grown):
            grown = again
    for begun in damped_starts(grown, declared, rows, before):
        again, _ = grow(begun, rows, before, progress)
        if _needs(again, begun, rows) and better(again, grown):
            grown = again
    for begun in (
        *coupled_starts(grown, rows, before),
        *richer_starts(grown, declared, rows, before),
    ):
        again, _ = grow(begun, rows, before, progress)
        if better(again, grown):
            grown = again
    for begun in islice(next_starts(grown, declared, rows, before), FOREMOST):
        progress("other effects to begin with")
        again, _ = grow(begun, rows, before, progress)
        if not _needs(again, begun, rows):
            again = _without_first(again, begun, rows)
        if again.score.loss < LEAVES * grown.score.loss and better(again, grown):
            return again
    return grown


def simpler_starts(grown: Grown, rows: Rows, before: Score) -> list[Grown]:
    """Return the simpler forms that the first effect contains, alone, as far as they are worth it.

    A second effect that is missing yet may be taken for what makes a form rich: a reflex that
    resists one direction for an asymmetry of friction.
    """
    starts = []
    for first in grown.steps[:1]:
        richer = first.taken.candidate
        for option in first.options:
            own = option.candidate
            if not richer.includes(own) or option.refused:
                continue
            begun = _begun(replace(first, taken=option), rows, before)
            if begun.steps[0].taken.z > MIN_Z:
                starts.append(begun)
    return starts


def damped_starts(grown: Grown, declared: Model, rows: Rows, before: Score) -> list[Grown]:
    """Return viscous friction alone, of every joint that was found to rub without it.

    Alone, Coulomb friction turns over as wide a part of the velocity as to do what damping does
    when slow, and then damping beside it gains nothing: neither is what it is without the other.
    """
    found = {step.key for step in grown.steps}
    rubbing = {s.taken.candidate.joint for s in grown.steps if s.taken.candidate.effect.rubs}
    damping = BY_NAME["viscous_friction"]
    tried = [
        Candidate(effect=damping, joint=joint)
        for joint in sorted(rubbing)
        if (damping.name, joint) not in found and damping.applies(rows.recording, joint)
    ]
    return [
        Grown(
            option.model,
            option.score,
            (Step(taken=option, equals=(), options=(option,), before=before.loss),),
        )
        for option in options_beside(declared, rows, before, tried)
        if not option.refused and option.z > MIN_Z
    ]


def coupled_starts(grown: Grown, rows: Rows, before: Score) -> Iterator[Grown]:
    """Yield a coupling alone where those at two joints explain much of each by itself.

    A muscle over both is a coupling at each, and either alone explains less than a wrong zero of
    the upper joint, which moves the weight at both. (A stranger's; another's shoulder lacked but an
    eighth of all that was missing.)
    """
    coupling = BY_NAME["cross_joint_coupling"]
    for first in grown.steps[:1]:
        coupled = [
            option
            for option in first.options
            if option.candidate.effect is coupling
            and not option.refused
            and _explains_much(option, before, rows)
        ]
        if first.taken.candidate.effect is not coupling and len(coupled) > 1:
            yield _begun(replace(first, taken=coupled[0]), rows, before)


def _explains_much(option: Option, before: Score, rows: Rows) -> bool:
    """Whether an effect takes much of what is left of its own joint."""
    own = rows.joint_of_block == option.candidate.joint
    left = float(before.losses[own].sum())
    return left - float(option.score.losses[own].sum()) > LARGE_GAIN * left


def richer_starts(grown: Grown, declared: Model, rows: Rows, before: Score) -> Iterator[Grown]:
    """Yield what grows from a limb's first effect, alone, if it predicts better.

    Beside the first, one end of the range may gain more than both in its place. (A stranger's
    limbs, nearly free over a fifth of their range: one wave over it, and K twice as large.) Whose
    ends leave a limb between them that would push away from its middle bend there, too: a cubic
    spring. (The unkind bench: K twice as wrong.)
    """
    for first in grown.steps[:1]:
        taken = first.taken
        for other in candidates(rows.recording):
            effect, joint = other.effect, other.joint
            grows = effect.limb and taken.candidate.effect.name in effect.grows_from
            if not grows or joint != taken.candidate.joint or other.key in declared.declared:
                continue
            if (found := tried_alone(declared, rows, other)) is None:
                continue
            option = _alone_option(other, found, before)
            option = _alone_option(other, refined(option, rows), before)
            gain, error = compare(taken.score.losses, option.score.losses)
            # What it has besides is as a further effect: a reflex of one side had a hundredth of
            # its gain on the other, too. (A stranger's.)
            enough = gain > max(error, MIN_LATER_GAIN * taken.score.loss)
            if enough and _restores(option, joint):
                step = replace(first, taken=option, equals=(), before=before.loss)
                yield Grown(option.model, option.score, (step,))


def _restores(option: Option, joint: int) -> bool:
    """Whether the stiffness that is declared at a joint, if any, would not be below none."""
    found = impedances(option.model, option.score.coefficients)
    return joint not in found or found[joint]["stiffness"] >= 0.0


def _alone_option(candidate: Candidate, fitted: tuple[Model, Score], before: Score) -> Option:
    """Return an effect that was fitted beside what is declared alone."""
    model, score = fitted
    gain, error = compare(before.losses, score.losses)
    return Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)


def next_starts(grown: Grown, declared: Model, rows: Rows, before: Score) -> Iterator[Grown]:
    """Yield the next best first effects, each alone, where what was found leaves much.

    The best may have stood for two: a reflex and a load were stiffness that rest builds up, and
    neither was looked for beside that. (A stranger's.)
    """
    if not grown.steps:
        return
    whole, left = explainable(declared, rows), explainable(grown.model, rows)
    if left.z <= MIN_Z or left.remains <= LEFT * whole.remains:
        return
    first = grown.steps[0]
    for option in first.options:
        same = option.candidate == first.taken.candidate
        if not (same or option.refused or option.gain <= LARGE_GAIN * before.loss):
            yield _begun(replace(first, taken=option), rows, before)


def _begun(step: Step, rows: Rows, before: Score) -> Grown:
    """Return a step's effect alone, refined."""
    option, alone = step.taken, _alone(step.taken)
    model, score = refined(replace(option, model=alone, score=evaluate(alone, rows)), rows)
    gain, error = compare(before.losses, score.losses)
    taken = replace(option, model=model, score=score, gain=gain, z=gain / error)
    return Grown(model, score, (replace(step, taken=taken, equals=(), before=before.loss),))


def _needs(again: Grown, begun: Grown, rows: Rows) -> bool:
    """Whether what was begun with is needed at the end, too."""
    bare = evaluate(again.model.without(begun.steps[0].taken.candidate), rows)
    gain, error = compare(bare.losses, again.score.losses)
    return gain > MIN_Z * error


def _without_first(again: Grown, begun: Grown, rows: Rows) -> Grown:
    """Return what was found without what that was begun with."""
    model = again.model.without(begun.steps[0].taken.candidate)
    steps = tuple(step for step in again.steps if step.key != begun.steps[0].key)
    return Grown(model, evaluate(model, rows), steps)


def _alone(option: Option) -> Model:
    """Return what is declared with the option's effect alone."""
    return option.model.keeping(lambda candidate: candidate == option.candidate)


def better(again: Grown, grown: Grown) -> bool:
    """Whether effects that were found from another start predict better, and by enough."""
    gain, error = compare(grown.score.losses, again.score.losses)
    if len(again.steps) <= len(grown.steps):
        return gain > error
    sure = gain > MIN_Z * error or rank_z(grown.score.losses, again.score.losses) > MIN_Z
    return sure and gain > MIN_LATER_GAIN * grown.score.loss
