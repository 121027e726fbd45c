"""Trace a residual to effects: gates, left-out groups, the simplest within one standard error.

Effects are added one at a time, at most three, each because it predicts trials that it was not
fitted to. A name is given only if these trials can tell it from what is declared, and only if it
explains most of what is explainable at all.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.candidates import ONE_WAY, Option, ladder, one_way, refined
from analysis.closeloop.identification.model import Model, declared_model, evaluate
from analysis.closeloop.identification.noise_ceiling import Ceiling, ceiling
from analysis.closeloop.identification.presliding import only_passage
from analysis.closeloop.identification.regression import Rows, Score, compare, rank_z, select_rows
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME

MAX_EFFECTS = 3
#: A gain must exceed this many of its standard errors: some 30 candidates at each of three steps.
MIN_Z = 4.0
#: ... and this share of the held-out loss, below which no number in a report would change.
MIN_GAIN = 0.03
#: Candidates whose gain differs by less than this share of the best count as equal.
EQUAL_SHARE = 0.005
#: A name must bring the loss this near to what splines reach, over what there was to explain.
MIN_EXPLAINED = 0.6
#: A later effect has to take this share of what the first left: what a form that is a little wrong
#: leaves behind is not another effect.
MIN_LATER_GAIN = 0.2
#: ... and this share of what the declared model left.
MIN_LATER_SHARE = 0.005
#: Least torque that an effect must explain, over the joint's effort (both root mean square): less
#: than that is what smoothing, or a joint that is not quite held, does to the declared torque.
MIN_TORQUE = 0.008
#: A gain that a few moments carry (inertia, at the ends of a ramp) has a large error of its own:
#: one of this share is real too if it exceeds fewer errors but comes back in several folds, or wins
#: nearly every block, and those folds that lose by it lose next to nothing.
LARGE_GAIN, LARGE_Z, LARGE_FOLDS, LARGE_LOST = 0.25, 2.5, 3, 0.05


@dataclass(frozen=True, kw_only=True)
class Step:
    """One effect added: the option taken, its equals, and the whole ladder for the report."""

    taken: Option
    equals: tuple[Option, ...]
    ladder: tuple[Option, ...]
    before: float


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What tracing found."""

    rows: Rows
    declared: Model
    declared_score: Score
    model: Model
    score: Score
    steps: tuple[Step, ...]
    verdict: Verdict
    #: Splines beyond the declared and beyond the final model.
    ceiling_before: Ceiling
    ceiling_after: Ceiling
    notes: tuple[str, ...] = ()


def trace(recording: Recording, progress: Callable[[str], None] = lambda _: None) -> Trace:
    """Find what the declared model of a recording lacks."""
    rows = select_rows(recording, recording.fit_trials)
    declared = declared_model(recording, rows)
    progress("what splines can explain")
    rows = rows.reweighted(ceiling(declared, rows).noise)
    before = evaluate(declared, rows)
    ceiling_before = ceiling(declared, rows)
    found, refused = _grown(Found(declared, before, ()), rows, before, progress)
    if refused is not None:
        return _unnamed(rows, declared, before, refused, ceiling_before)
    for begun in _simpler_starts(found, rows, before):
        again, _ = _grown(begun, rows, before, progress)
        if _better(again, found):
            found = again
    model, current, steps = found.model, found.score, found.steps
    ceiling_after = ceiling(model, rows) if steps else ceiling_before
    return _with_rests(
        _judged(
            Trace(
                rows=rows,
                declared=declared,
                declared_score=before,
                model=model,
                score=current,
                steps=tuple(steps),
                verdict=Verdict.EFFECT_FOUND if steps else Verdict.ADEQUATE,
                ceiling_before=ceiling_before,
                ceiling_after=ceiling_after,
            )
        )
    )


@dataclass(frozen=True)
class Found:
    """A model that effects were added to, and how."""

    model: Model
    score: Score
    steps: tuple[Step, ...]


def _grown(
    found: Found, rows: Rows, before: Score, progress: Callable[[str], None]
) -> tuple[Found, Step | None]:
    """Add effects one at a time, then try each again beside the others.

    Returns the model with its effects, and the first step if it is one that nothing may name.
    """
    model, current, steps = found.model, found.score, list(found.steps)
    while len(steps) < MAX_EFFECTS:
        progress(f"candidates for effect {len(steps) + 1}")
        rungs = ladder(model, rows, current)
        least = _least_later(current, before) if steps else MIN_GAIN * current.loss
        step = _choose(rungs, model, current, rows, least)
        if step is None:
            break
        if step.taken.refused:
            if not steps:
                return found, step
            break
        model, current = refined(step.taken, rows)
        active = {candidate.key for candidate in model.effects}
        # A richer friction replaces the plain one that an earlier step added.
        steps = [s for s in steps if s.taken.candidate.key in active]
        steps.append(replace(step, taken=replace(step.taken, model=model, score=current)))
    if len(steps) > 1:
        progress("each effect again, beside the others")
        model, current, steps = _retested(model, current, steps, rows, before)
    return Found(model, current, tuple(steps)), None


def _simpler_starts(found: Found, rows: Rows, before: Score) -> list[Found]:
    """Return the simpler forms that the first effect contains, alone, as far as they are worth it.

    A second effect that is missing yet may be taken for what makes a form rich: a reflex that
    resists one direction for an asymmetry of friction.
    """
    starts = []
    for first in found.steps[:1]:
        for option in first.ladder:
            own = option.candidate
            if (
                own.joint != first.taken.candidate.joint
                or own.effect.name not in first.taken.candidate.effect.includes
                or option.refused
            ):
                continue
            terms = tuple(t for t in option.model.terms if t.candidate in (None, own))
            alone = replace(option.model, terms=terms, channels=())
            model, score = refined(replace(option, model=alone, score=evaluate(alone, rows)), rows)
            gain, error = compare(before.losses, score.losses)
            taken = replace(option, model=model, score=score, gain=gain, z=gain / error)
            if taken.z > MIN_Z:
                step = replace(first, taken=taken, equals=(), before=before.loss)
                starts.append(Found(model, score, (step,)))
    return starts


def _better(again: Found, found: Found) -> bool:
    """Whether effects that were found from another start predict better, and by enough."""
    gain, error = compare(found.score.losses, again.score.losses)
    if len(again.steps) <= len(found.steps):
        return gain > error
    sure = gain > MIN_Z * error or rank_z(found.score.losses, again.score.losses) > MIN_Z
    return sure and gain > MIN_LATER_GAIN * found.score.loss


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
    """Withhold names that leave too much of what is explainable."""
    left = found.ceiling_after
    remains = left.model_loss - left.ceiling_loss
    rows = found.rows
    matters = MIN_TORQUE**2 * min(rows.effort_power(joint) for joint in rows.samples)
    steady = left.rank_z > MIN_Z and remains > LARGE_GAIN * left.model_loss
    real = (left.z > MIN_Z or steady) and remains > max(MIN_GAIN * left.model_loss, matters)
    if not found.steps and _once(found.rows):
        return replace(found, verdict=Verdict.NOT_IDENTIFIABLE, notes=(ONE_WAY,))
    if not found.steps:
        return replace(found, verdict=Verdict.UNEXPLAINED if real else Verdict.ADEQUATE)
    explained = found.ceiling_before.model_loss - left.model_loss
    if real and explained < MIN_EXPLAINED * (explained + remains):
        names = ", ".join(step.taken.candidate.effect.name for step in found.steps)
        return replace(
            found,
            verdict=Verdict.UNEXPLAINED,
            model=found.declared,
            score=found.declared_score,
            steps=(),
            ceiling_after=found.ceiling_before,
            notes=(
                f"{names} came nearest, but left "
                f"{100 * remains / (explained + remains):.0f} % of the explainable residual; "
                "no name is given",
            ),
        )
    return found


def _once(rows: Rows) -> bool:
    """Whether all there is to fit is one movement in one direction: K, D and q0 hide friction."""
    return not rows.grouped and all(one_way(rows, joint) for joint in rows.samples)


def _unnamed(
    rows: Rows, declared: Model, before: Score, step: Step, ceiling_before: Ceiling
) -> Trace:
    return Trace(
        rows=rows,
        declared=declared,
        declared_score=before,
        model=declared,
        score=before,
        steps=(replace(step, equals=_others(step)),),
        verdict=Verdict.NOT_IDENTIFIABLE,
        ceiling_before=ceiling_before,
        ceiling_after=ceiling_before,
        notes=(step.taken.refused,),
    )


def _others(step: Step) -> tuple[Option, ...]:
    """Return every option that would pass for the one taken where nothing can be told apart."""
    return tuple(o for o in step.ladder if o is not step.taken and o.gain > 0.5 * step.taken.gain)


def _choose(
    rungs: list[Option], model: Model, current: Score, rows: Rows, least: float
) -> Step | None:
    """Return the simplest option that is as good as the best, or None if none is worth adding."""
    worth = [o for o in rungs if _worth(o, current, rows, least)]
    worth = [o for o in worth if not only_passage(o, model, rows)]
    if not worth:
        return None
    best = worth[0]
    equals = []
    for option in worth:
        lost, error = compare(option.score.losses, best.score.losses)
        if lost <= error or lost <= EQUAL_SHARE * best.gain:
            equals.append(option)
    taken = min(equals, key=lambda o: (_new_parameters(o), -o.gain))
    for twin in equals:
        # A twin with one parameter more fits at least as well; by luck, or because it is the one?
        if taken.candidate.effect.name in twin.candidate.effect.twins:
            lost, error = compare(taken.score.losses, twin.score.losses)
            if lost > error:
                taken = twin
    taken = next((o for o in equals if _carries_more(o, taken)), taken)
    return Step(
        taken=taken,
        equals=tuple(o for o in equals if o is not taken and not _nested(o, taken)),
        ladder=tuple(rungs),
        before=current.loss,
    )


def _carries_more(option: Option, taken: Option) -> bool:
    """Whether a mass or inertia found already makes `option` likelier than a torque gain.

    With a free inertia beside it, a payload at any distance is a gain; no coincidence speaks for
    the gain then, and what hangs on a limb has both mass and inertia.
    """
    a, b = option.candidate, taken.candidate
    beside = [c.effect for c in option.model.effects if c.joint == a.joint and c != a]
    return (
        b.effect.scales_effort
        and a.joint == b.joint
        and a.effect.adds_mass
        and any(effect.adds_mass for effect in beside)
        and not option.refused
    )


def _new_parameters(option: Option) -> int:
    """Return the number of parameters an option adds to the simpler form that it replaces."""
    effect, joint = option.candidate.effect, option.candidate.joint
    return effect.complexity - max(
        (BY_NAME[name].complexity for name in effect.includes if (name, joint) in option.replaced),
        default=0,
    )


def _worth(option: Option, current: Score, rows: Rows, least: float) -> bool:
    """Whether a gain is more than luck, and large enough to matter."""
    matters = MIN_TORQUE**2 * rows.effort_power(option.candidate.joint)
    if option.gain <= max(least, matters):
        return False
    if option.z > MIN_Z:
        return True
    folds = np.bincount(rows.fold_of_block, current.losses - option.score.losses)
    won, lost = float(folds[folds > 0].sum()), float(-folds[folds < 0].sum())
    if option.gain <= LARGE_GAIN * current.loss or lost >= LARGE_LOST * won:
        return False
    several = int((folds > LARGE_LOST * won).sum()) >= LARGE_FOLDS
    return (option.z > LARGE_Z and several) or rank_z(current.losses, option.score.losses) > MIN_Z


def _nested(option: Option, taken: Option) -> bool:
    """Whether one of the two is a special case of the other, which always fits as well."""
    a, b = option.candidate, taken.candidate
    return a.joint == b.joint and (
        b.effect.name in a.effect.includes or a.effect.name in b.effect.includes
    )


def _least_later(current: Score, before: Score) -> float:
    """Return the held-out loss that a second or third effect has to take away."""
    return max(MIN_LATER_GAIN * current.loss, MIN_LATER_SHARE * before.loss)


def _retested(
    model: Model, current: Score, steps: list[Step], rows: Rows, before: Score
) -> tuple[Model, Score, list[Step]]:
    """Take each effect out again: drop it if it is not missed, or let a better name replace it."""
    for step in list(steps):
        if len(steps) < 2:
            break
        key = step.taken.candidate.key
        rest = model.without(step.taken.candidate)
        without = evaluate(rest, rows)
        missed, error = compare(without.losses, current.losses)
        if missed < MIN_Z * error or missed < MIN_GAIN * without.loss:
            model, current = rest, without
            steps = [s for s in steps if s is not step]
            continue
        least = _least_later(without, before)
        again = _choose(ladder(rest, rows, without), rest, without, rows, least)
        if again is None or again.taken.refused:
            continue
        changed, rescored = refined(again.taken, rows)
        new = replace(again, taken=replace(again.taken, model=changed, score=rescored))
        equal = again.taken.candidate.key == key or _carries_more(again.taken, step.taken)
        if equal or rescored.loss < current.loss:
            active = {candidate.key for candidate in changed.effects}
            model, current = changed, rescored
            steps = [new if s is step else s for s in steps]
            steps = [s for s in steps if s.taken.candidate.key in active]
    return model, current, steps


def p_value(z: float, tried: int) -> float:
    """Return the chance of a gain of `z` standard errors by luck, over all candidates tried."""
    return float(min(1.0, max(tried, 1) * norm.sf(z)))
