"""Add effects to a model one at a time, each because it predicts what it was not fitted to."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from analysis.closeloop.identification.balance.declared import declared_again
from analysis.closeloop.identification.balance.model import Candidate, Model, evaluate
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    compare,
    rank_z,
)
from analysis.closeloop.identification.candidates import candidates, options_beside, refined
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.selection import (
    ALONE_Z,
    MIN_GAIN,
    MIN_LATER_GAIN,
    MIN_Z,
    carries_more,
    choose,
    more_than_luck,
)

#: Effects that are looked for at a time.
MAX_EFFECTS = 3
#: Beside `MIN_LATER_GAIN`, a later effect takes this share of what the declared model left.
MIN_LATER_SHARE = 0.005


@dataclass(frozen=True)
class Grown:
    """A model that effects were added to, and how."""

    model: Model
    score: Score
    steps: tuple[Step, ...] = ()


def grow(
    begun: Grown,
    rows: Rows,
    before: Score,
    progress: Callable[[str], None],
    tried: Collection[Candidate] | None = None,
) -> tuple[Grown, Step | None]:
    """Add effects one at a time, then try each again beside the others.

    Args:
        begun: the model to add to. Effects that it has may be replaced by a richer form only.
        rows: the samples to fit.
        before: the score that later effects are compared with.
        progress: is told what is done.
        tried: which effects to try; every one that can be asked of the joints if None.

    Returns:
        The model with its effects, and the first step if it is one that nothing may name.
    """
    tried = candidates(rows.recording) if tried is None else tried
    grown = begun
    stands = {step.key for step in begun.steps}
    while len(_added(grown, stands)) < MAX_EFFECTS:
        progress(f"candidates for effect {len(grown.steps) + 1}")
        least = MIN_GAIN * grown.score.loss
        if stands:
            least = max(least, MIN_LATER_SHARE * before.loss)
        if _added(grown, stands):
            least = _least_later(grown.score, before)
        step = _next_step(grown.model, grown.score, rows, least, tried)
        if step is None:
            break
        if step.taken.refused:
            if not grown.steps:
                return begun, step
            break
        # A richer friction replaces the plain one that an earlier step added.
        grown = _with_steps((*grown.steps, step), step)
    if len(grown.steps) > 1 and _added(grown, stands):
        progress("each effect again, beside the others")
        grown = _retested(grown, rows, before, tried, stands)
    return grown, None


def _added(grown: Grown, stands: Collection[tuple[str, int]]) -> list[Step]:
    return [step for step in grown.steps if step.key not in stands]


def _next_step(
    model: Model, current: Score, rows: Rows, least: float, tried: Collection[Candidate]
) -> Step | None:
    """Return the effect to add to a model, refined unless it may not be named; None for none."""
    step = choose(options_beside(model, rows, current, tried), model, current, rows, least)
    if step is None or step.taken.refused:
        return step
    refitted, score = refined(step.taken, rows)
    refitted = declared_again(refitted, rows)
    score = evaluate(refitted, rows)
    return replace(step, taken=replace(step.taken, model=refitted, score=score))


def _with_steps(steps: Sequence[Step], last: Step) -> Grown:
    """Return the model of the step taken last, with the steps whose effects are still in it."""
    model, score = last.taken.model, last.taken.score
    active = {candidate.key for candidate in model.effects}
    return Grown(model, score, tuple(step for step in steps if step.key in active))


def _retested(
    grown: Grown,
    rows: Rows,
    before: Score,
    tried: Collection[Candidate],
    stands: Collection[tuple[str, int]],
) -> Grown:
    """Take each effect out again: drop it if it is not missed, or let a better name replace it."""
    for step in _added(grown, stands):
        if len(grown.steps) < 2:
            break
        rest = grown.model.without(step.taken.candidate)
        without = evaluate(rest, rows)
        missed = without.loss - grown.score.loss
        folds = rows.fold_of_block
        real = more_than_luck(without.losses, grown.score.losses, folds, ALONE_Z)
        if not real or missed < MIN_GAIN * without.loss:
            grown = Grown(rest, without, tuple(s for s in grown.steps if s is not step))
            continue
        again = _next_step(rest, without, rows, _least_later(without, before), tried)
        if again is None or again.taken.refused:
            continue
        equal = again.key == step.key or carries_more(again.taken, step.taken)
        if equal or again.taken.score.loss < grown.score.loss:
            grown = _with_steps([again if s is step else s for s in grown.steps], again)
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


def _least_later(current: Score, before: Score) -> float:
    """Return the held-out loss that a second or third effect has to take away."""
    return max(MIN_LATER_GAIN * current.loss, MIN_LATER_SHARE * before.loss)
