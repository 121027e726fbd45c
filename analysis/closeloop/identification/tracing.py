"""Trace a residual to effects, each because it predicts trials that it was not fitted to.

Of a limb they are added one at a time, until nothing is worth adding; a robot is traced as a whole,
be it of one joint (`robot`). A name is given only if these trials can tell it from what is
declared, and only if it explains most of what is explainable at all.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.arms.explainable import explainable_by_joint
from analysis.closeloop.identification.arms.gains import untold_gain
from analysis.closeloop.identification.arms.holdouts import not_worse
from analysis.closeloop.identification.arms.motors import untold_motors
from analysis.closeloop.identification.arms.robot import (
    as_declared,
    traced_robot,
    weighed,
    with_ordinary_again,
)
from analysis.closeloop.identification.arms.tilted import with_tilt
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.luck import LARGE_GAIN, MIN_GAIN, MIN_TORQUE, MIN_Z
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.sticking import sliding_anyway
from analysis.closeloop.identification.candidates import candidates
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Grown, Option, Step, Trace
from analysis.closeloop.identification.friction.at_turns import with_peak_at_turns
from analysis.closeloop.identification.friction.breakaway import with_breakaway
from analysis.closeloop.identification.friction.excess import with_settled_excess
from analysis.closeloop.identification.growing.friction_laws import with_wound_laws
from analysis.closeloop.identification.growing.plain_law import with_plain_law
from analysis.closeloop.identification.growing.slid import grown_slid
from analysis.closeloop.identification.growing.starts import regrown
from analysis.closeloop.identification.growing.steps import grow
from analysis.closeloop.identification.holding import (
    determined,
    held_in_octaves,
    in_plainest_form,
    passive,
    sized,
)
from analysis.closeloop.identification.loads.askew import with_gains_askew
from analysis.closeloop.identification.nameable import ONE_WAY, moves_one_way
from analysis.closeloop.identification.places import with_told_places
from analysis.closeloop.identification.presliding import rubbing_anyway
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, LINK_INERTIA

#: A name must bring the loss this near to what splines reach, over what there was to explain.
MIN_EXPLAINED = 0.6


def trace(recording: Recording, progress: Callable[[str], None] = lambda _: None) -> Trace:
    """Find what the declared model of a recording lacks."""
    rows = select_rows(recording, recording.fit_trials)
    declared = declared_model(recording, rows)
    limbs = set(recording.limbs).intersection(recording.joints)
    if not limbs:
        return _robot(declared, rows, progress)
    progress("what splines can explain")
    rows = _sliding(declared, rows)
    rows = rows.reweighted(explainable(declared, rows).noise)
    before = evaluate(declared, rows)
    beyond = explainable(declared, rows)
    found = Trace(
        rows=rows,
        declared=declared,
        declared_score=before,
        model=declared,
        score=before,
        steps=(),
        verdict=Verdict.ADEQUATE,
        explainable_before=beyond,
        explainable_after=beyond,
    )
    grown, refused = grow(Grown(declared, before), rows, before, progress)
    if refused is not None:
        # Of a base that stands askew no joint by itself tells enough. (A stranger's, 9 degrees.)
        alone = Grown(refused.taken.model, refused.taken.score, (refused,))
        grown = with_tilt(alone, rows)
        refused = refused if grown is alone else None
    if refused is not None:
        step = replace(refused, equals=_others(refused))
        taken = refused.taken
        return replace(
            found,
            steps=(step,),
            verdict=Verdict.NOT_IDENTIFIABLE,
            supposed=(taken.model, taken.score.coefficients),
            notes=(taken.refused,),
        )
    grown = regrown(grown, declared, rows, before, progress)
    grown, rows = grown_slid(grown, declared, rows, progress)
    grown, notes = _stands(grown, declared, rows, progress)
    grown = with_gains_askew(grown, rows)
    if rows is not found.rows:
        beyond = explainable(declared, rows)
        found = replace(
            found,
            rows=rows,
            declared_score=evaluate(declared, rows),
            explainable_before=beyond,
        )
    if grown.steps:
        beyond = explainable(grown.model, rows)
    found = replace(
        found,
        model=grown.model,
        score=grown.score,
        steps=grown.steps,
        explainable_after=beyond,
        notes=notes,
    )
    return _with_rests(_judged(found))


def _stands(
    grown: Grown, declared: Model, rows: Rows, progress: Callable[[str], None]
) -> tuple[Grown, tuple[str, ...]]:
    """Take out what does not stand, and look once for others if nothing does.

    What was taken first may have stood for the pair that is missing. (A cuff's spring beside an end
    of range: an opponent's.)
    """
    held, notes = _held(grown, declared, rows)
    if held.steps or not grown.steps:
        return held, notes
    fallen = {step.key for step in grown.steps}
    tried = [one for one in candidates(rows.recording) if one.key not in fallen]
    bare = Grown(held.model, held.score)
    again, refused = grow(bare, rows, held.score, progress, tried)
    if refused is not None or not again.steps:
        return held, notes
    again, further = _held(again, declared, rows)
    return again, notes + further


def _held(grown: Grown, declared: Model, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out what does not stand, and say why."""
    grown = with_wound_laws(with_plain_law(grown, rows), rows)
    grown, refusals = held_in_octaves(grown, rows)
    grown, driving = passive(grown, rows)
    grown, unsure = determined(in_plainest_form(grown, rows), rows)
    grown, any_size = sized(grown, rows)
    grown = with_tilt(with_told_places(grown, rows), rows)
    grown, notes = not_worse(grown, declared, rows)
    return grown, (*refusals, *driving, *unsure, *any_size, *notes)


def _sliding(declared: Model, rows: Rows) -> Rows:
    """Return the rows without those in which a limb's device sticks, if most is left there.

    What its friction is there no motion shows: a delay, an early one too, took it from both sides
    of every reversal (an opponent's).
    """
    model = declared
    for joint in rows.joints:
        model = rubbing_anyway(model, joint)
    return sliding_anyway(model, rows)


def _robot(declared: Model, rows: Rows, progress: Callable[[str], None]) -> Trace:
    """Find what the declared model of a device without a limb lacks."""
    grown, rows, notes = _robot_grown(declared, rows, progress)
    progress("what splines can explain")
    beyond = explainable_by_joint(declared, rows)
    return _with_rests(
        _judged(
            Trace(
                rows=rows,
                declared=declared,
                declared_score=evaluate(declared, rows),
                model=grown.model,
                score=grown.score,
                steps=grown.steps,
                verdict=Verdict.ADEQUATE,
                explainable_before=beyond,
                explainable_after=explainable_by_joint(grown.model, rows)
                if grown.steps
                else beyond,
                notes=(
                    *notes,
                    *untold_motors(grown.model, rows),
                    *untold_gain(grown.model, grown.score.coefficients, rows),
                ),
            )
        )
    )


def _robot_grown(
    declared: Model, every: Rows, progress: Callable[[str], None], *, links_free: bool = True
) -> tuple[Grown, Rows, tuple[str, ...]]:
    """Return what stands of a robot's effects, the rows that they were fitted to, and notes.

    Args:
        declared: the model as declared.
        every: samples of all joints.
        progress: is told what is done.
        links_free: whether links other than declared may be found.
    """
    rows = weighed(declared, every)
    grown = traced_robot(declared, rows, progress, links_free=links_free)
    grown, rows, turned = with_peak_at_turns(with_settled_excess(grown, rows), rows, every)
    grown, held = with_breakaway(grown, rows)
    grown, refusals = held_in_octaves(grown, rows, damped=True)
    grown, unsure = determined(in_plainest_form(grown, rows), rows)
    if refusals or unsure:
        # It may have stood for friction. (A Sawyer's wrong zero, and a joint without a name.)
        grown, further = determined(with_ordinary_again(grown, rows), rows)
        unsure += further
    grown, any_size = sized(grown, rows)
    found = with_tilt(with_told_places(grown, rows), rows)
    grown, notes = not_worse(found, declared, rows)
    if links_free and _has_links(found) and not _has_links(grown):
        # What was found beside other links stood on them. (Of an iiwa of LASA: a gain, a coupling
        # and a ripple.)
        return _robot_grown(declared, every, as_declared(progress), links_free=False)
    return grown, rows, (*turned, *held, *refusals, *unsure, *any_size, *notes)


def _has_links(grown: Grown) -> bool:
    return any(step.key[0] == LINK_INERTIA for step in grown.steps)


def _with_rests(found: Trace) -> Trace:
    """Fit once more with the samples at rest, unless friction makes them worthless."""
    recording = found.rows.recording
    effects = [BY_NAME[entry.effect] for entry in recording.session.declared]
    effects += [step.taken.candidate.effect for step in found.steps]
    rubs = any(effect.rubs for effect in effects)
    if rubs or np.any(recording.device.friction) or found.verdict == Verdict.UNEXPLAINED:
        return found
    rows = select_rows(recording, recording.fit_trials, rests=True)
    rows = rows.reweighted(found.explainable_before.noise)
    # Where rests are elsewhere in every trial, as after a sensor's zero was set anew, they take the
    # model away from what it predicted. (A stranger's: K came out below none.)
    again = Grown(found.model, evaluate(found.model, rows), found.steps)
    # Of an arm's wrong zero they may show that it can be any. (A Sawyer's, -0.5 +- 1.2 rad.)
    again, unsure = determined(again, rows)
    again, worse = not_worse(again, found.declared, rows)
    worse = (*unsure, *worse)
    if found.steps and not again.steps:
        return found.without_names(f"fitted to the rests, too, {'; '.join(worse)}")
    return replace(
        found,
        rows=rows,
        declared_score=evaluate(found.declared, rows),
        model=again.model,
        score=again.score,
        steps=again.steps,
        notes=(*found.notes, *worse),
    )


def _judged(found: Trace) -> Trace:
    """Give the verdict, and withhold names that leave too much of what is explainable."""
    left, rows = found.explainable_after, found.rows
    matters = MIN_TORQUE**2 * min(rows.effort_power(joint) for joint in rows.samples)
    steady = left.rank_z > MIN_Z and left.remains > LARGE_GAIN * left.model_loss
    real = (left.z > MIN_Z or steady) and left.remains > max(MIN_GAIN * left.model_loss, matters)
    if not found.steps and moves_one_way(rows) and (real or not rows.grouped):
        return replace(found, verdict=Verdict.NOT_IDENTIFIABLE, notes=(*found.notes, ONE_WAY))
    if not found.steps:
        return replace(found, verdict=Verdict.UNEXPLAINED if real else Verdict.ADEQUATE)
    explained = found.explainable_before.model_loss - left.model_loss
    explainable = explained + left.remains
    if real and explained < MIN_EXPLAINED * explainable:
        names = ", ".join(step.taken.candidate.effect.name for step in found.steps)
        return found.without_names(
            f"{names} came nearest, but left {100 * left.remains / explainable:.0f} % of the "
            "explainable residual; no name is given"
        )
    return replace(found, verdict=Verdict.EFFECT_FOUND)


def _others(step: Step) -> tuple[Option, ...]:
    """Return every option that would pass for the one taken where nothing can be told apart."""
    return tuple(o for o in step.options if o is not step.taken and o.gain > 0.5 * step.taken.gain)
