"""Trace a residual to effects: one at a time, by left-out groups, until nothing is worth adding.

Effects are added one at a time, at most three, each because it predicts trials that it was not
fitted to. A name is given only if these trials can tell it from what is declared, and only if it
explains most of what is explainable at all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.candidates import ONE_WAY, one_way, options_beside, refined
from analysis.closeloop.identification.findings import Option, Step, Trace
from analysis.closeloop.identification.model import Model, declared_model, evaluate
from analysis.closeloop.identification.noise_ceiling import noise_ceiling
from analysis.closeloop.identification.regression import Rows, Score, compare, rank_z, select_rows
from analysis.closeloop.identification.selection import (
    LARGE_GAIN,
    MIN_TORQUE,
    MIN_Z,
    carries_more,
    choose,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME

MAX_EFFECTS = 3
#: Least share of the held-out loss that a gain takes, below which no number in a report changes.
MIN_GAIN = 0.03
#: A name must bring the loss this near to what splines reach, over what there was to explain.
MIN_EXPLAINED = 0.6
#: A later effect has to take this share of what the first left: what a form that is a little wrong
#: leaves behind is not another effect.
MIN_LATER_GAIN = 0.2
#: ... and this share of what the declared model left.
MIN_LATER_SHARE = 0.005


@dataclass(frozen=True)
class Grown:
    """A model that effects were added to, and how."""

    model: Model
    score: Score
    steps: tuple[Step, ...] = ()


def trace(recording: Recording, progress: Callable[[str], None] = lambda _: None) -> Trace:
    """Find what the declared model of a recording lacks."""
    rows = select_rows(recording, recording.fit_trials)
    declared = declared_model(recording, rows)
    progress("what splines can explain")
    rows = rows.reweighted(noise_ceiling(declared, rows).noise)
    before = evaluate(declared, rows)
    ceiling = noise_ceiling(declared, rows)
    found = Trace(
        rows=rows,
        declared=declared,
        declared_score=before,
        model=declared,
        score=before,
        steps=(),
        verdict=Verdict.ADEQUATE,
        ceiling_before=ceiling,
        ceiling_after=ceiling,
    )
    grown, refused = _grown(Grown(declared, before), rows, before, progress)
    if refused is not None:
        step = replace(refused, equals=_others(refused))
        notes = (refused.taken.refused,)
        return replace(found, steps=(step,), verdict=Verdict.NOT_IDENTIFIABLE, notes=notes)
    for begun in _simpler_starts(grown, rows, before):
        again, _ = _grown(begun, rows, before, progress)
        if _better(again, grown):
            grown = again
    if grown.steps:
        ceiling = noise_ceiling(grown.model, rows)
    found = replace(
        found, model=grown.model, score=grown.score, steps=grown.steps, ceiling_after=ceiling
    )
    return _with_rests(_judged(found))


def _grown(
    begun: Grown, rows: Rows, before: Score, progress: Callable[[str], None]
) -> tuple[Grown, Step | None]:
    """Add effects one at a time, then try each again beside the others.

    Returns the model with its effects, and the first step if it is one that nothing may name.
    """
    grown = begun
    while len(grown.steps) < MAX_EFFECTS:
        progress(f"candidates for effect {len(grown.steps) + 1}")
        least = MIN_GAIN * grown.score.loss
        if grown.steps:
            least = _least_later(grown.score, before)
        step = _next_step(grown.model, grown.score, rows, least)
        if step is None:
            break
        if step.taken.refused:
            if not grown.steps:
                return begun, step
            break
        # A richer friction replaces the plain one that an earlier step added.
        grown = _with_steps((*grown.steps, step), step)
    if len(grown.steps) > 1:
        progress("each effect again, beside the others")
        grown = _retested(grown, rows, before)
    return grown, None


def _next_step(model: Model, current: Score, rows: Rows, least: float) -> Step | None:
    """Return the effect to add to a model, refined unless it may not be named; None for none."""
    step = choose(options_beside(model, rows, current), model, current, rows, least)
    if step is None or step.taken.refused:
        return step
    refitted, score = refined(step.taken, rows)
    return replace(step, taken=replace(step.taken, model=refitted, score=score))


def _with_steps(steps: Sequence[Step], last: Step) -> Grown:
    """Return the model of the step taken last, with the steps whose effects are still in it."""
    model, score = last.taken.model, last.taken.score
    active = {candidate.key for candidate in model.effects}
    return Grown(model, score, tuple(step for step in steps if step.key in active))


def _retested(grown: Grown, rows: Rows, before: Score) -> Grown:
    """Take each effect out again: drop it if it is not missed, or let a better name replace it."""
    for step in grown.steps:
        if len(grown.steps) < 2:
            break
        rest = grown.model.without(step.taken.candidate)
        without = evaluate(rest, rows)
        missed, error = compare(without.losses, grown.score.losses)
        if missed < MIN_Z * error or missed < MIN_GAIN * without.loss:
            grown = Grown(rest, without, tuple(s for s in grown.steps if s is not step))
            continue
        again = _next_step(rest, without, rows, _least_later(without, before))
        if again is None or again.taken.refused:
            continue
        equal = again.key == step.key or carries_more(again.taken, step.taken)
        if equal or again.taken.score.loss < grown.score.loss:
            grown = _with_steps([again if s is step else s for s in grown.steps], again)
    return grown


def _simpler_starts(grown: Grown, rows: Rows, before: Score) -> list[Grown]:
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


def _better(again: Grown, grown: Grown) -> bool:
    """Whether effects that were found from another start predict better, and by enough."""
    gain, error = compare(grown.score.losses, again.score.losses)
    if len(again.steps) <= len(grown.steps):
        return gain > error
    sure = gain > MIN_Z * error or rank_z(grown.score.losses, again.score.losses) > MIN_Z
    return sure and gain > MIN_LATER_GAIN * grown.score.loss


def _with_rests(found: Trace) -> Trace:
    """Fit once more with the samples at rest, unless friction makes them worthless."""
    recording = found.rows.recording
    effects = [BY_NAME[entry.effect] for entry in recording.session.declared]
    effects += [step.taken.candidate.effect for step in found.steps]
    rubs = any(effect.rubs for effect in effects)
    if rubs or np.any(recording.device.friction) or found.verdict == Verdict.UNEXPLAINED:
        return found
    rows = select_rows(recording, recording.fit_trials, rests=True)
    rows = rows.reweighted(found.ceiling_before.noise)
    return replace(
        found,
        rows=rows,
        declared_score=evaluate(found.declared, rows),
        score=evaluate(found.model, rows),
    )


def _judged(found: Trace) -> Trace:
    """Give the verdict, and withhold names that leave too much of what is explainable."""
    left, rows = found.ceiling_after, found.rows
    matters = MIN_TORQUE**2 * min(rows.effort_power(joint) for joint in rows.samples)
    steady = left.rank_z > MIN_Z and left.remains > LARGE_GAIN * left.model_loss
    real = (left.z > MIN_Z or steady) and left.remains > max(MIN_GAIN * left.model_loss, matters)
    if not found.steps and _once(rows):
        return replace(found, verdict=Verdict.NOT_IDENTIFIABLE, notes=(ONE_WAY,))
    if not found.steps:
        return replace(found, verdict=Verdict.UNEXPLAINED if real else Verdict.ADEQUATE)
    explained = found.ceiling_before.model_loss - left.model_loss
    explainable = explained + left.remains
    if real and explained < MIN_EXPLAINED * explainable:
        names = ", ".join(step.taken.candidate.effect.name for step in found.steps)
        return found.without_names(
            f"{names} came nearest, but left {100 * left.remains / explainable:.0f} % of the "
            "explainable residual; no name is given"
        )
    return replace(found, verdict=Verdict.EFFECT_FOUND)


def _once(rows: Rows) -> bool:
    """Whether all there is to fit is one movement in one direction: K, D and q0 hide friction."""
    return not rows.grouped and all(one_way(rows, joint) for joint in rows.samples)


def _others(step: Step) -> tuple[Option, ...]:
    """Return every option that would pass for the one taken where nothing can be told apart."""
    return tuple(o for o in step.options if o is not step.taken and o.gain > 0.5 * step.taken.gain)


def _least_later(current: Score, before: Score) -> float:
    """Return the held-out loss that a second or third effect has to take away."""
    return max(MIN_LATER_GAIN * current.loss, MIN_LATER_SHARE * before.loss)
