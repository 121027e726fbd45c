"""Other first effects to begin with, where one effect at a time may have begun with a wrong one."""

from collections.abc import Callable
from dataclasses import replace

from analysis.closeloop.identification.balance.luck import MIN_LATER_GAIN, MIN_Z
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, Score, compare, rank_z
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import options_beside, refined
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.growing.steps import grow
from sim.effects.catalogue import BY_NAME


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
        # What was begun with has to be needed at the end, too.
        bare = evaluate(again.model.without(begun.steps[0].taken.candidate), rows)
        gain, error = compare(bare.losses, again.score.losses)
        if gain > MIN_Z * error and better(again, grown):
            grown = again
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
            alone = _alone(option)
            model, score = refined(replace(option, model=alone, score=evaluate(alone, rows)), rows)
            gain, error = compare(before.losses, score.losses)
            taken = replace(option, model=model, score=score, gain=gain, z=gain / error)
            if taken.z > MIN_Z:
                step = replace(first, taken=taken, equals=(), before=before.loss)
                starts.append(Grown(model, score, (step,)))
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
