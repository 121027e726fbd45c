"""Names that do not hold: of a size that may be none, or of one size here and another there."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    MIN_GAIN,
    MIN_Z,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import evaluate, impedances
from analysis.closeloop.identification.balance.presence import surely_there
from analysis.closeloop.identification.balance.regression import Rows, compare, takes_all
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.octaves import differs_elsewhere
from analysis.closeloop.identification.parameters import of_any_size
from sim.effects.catalogue import BY_NAME, LINK_INERTIA
from sim.effects.laws.inertia import LEAST_LOAD

DAMPING = "viscous_friction"
DRIVES = "beside it the limb would give energy, since its damping would be below none"


def held_in_octaves(
    grown: Grown, rows: Rows, *, damped: bool = False
) -> tuple[Grown, tuple[str, ...]]:
    """Take out what filters the motion and has another size elsewhere, the last found first.

    Of other effects, what else is missing yet may differ from octave to octave.

    Args:
        grown: the model with its effects.
        rows: the samples that were fitted.
        damped: whether damping beside friction is expected, as of a robot's joint, and stays: what
            friction leaves where it turns lies in other octaves than what only damping explains.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """

    def fails(grown: Grown) -> Step | None:
        asked = (s for s in reversed(grown.steps) if not (damped and _rubs_besides(grown, s)))
        return next((step for step in asked if _differs(grown, step, rows)), None)

    return _without(
        grown,
        rows,
        fails,
        "it would have another size at one frequency than at the others, as the controller's "
        "answer to an unknown torque has",
    )


def passive(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out what passes the motion on beside a limb that would surely drive the device.

    A late effort makes damping look too small, and to know how late it is mends that. What leaves
    it below none answered something else: to a torque that nobody knows, such as a tremor, the
    controller has one gain and one phase, too. Arguments and result are those of `held_in_octaves`.
    """
    return _without(grown, rows, lambda grown: _driven(grown, rows), DRIVES)


def _passes(step: Step, rows: Rows) -> bool:
    """Whether a step passes on the motion of a limb, as a spring does.

    With the form held it answers noise of the motion at the frequencies where that swings; which
    those are is what the trials have to agree on, too. (Found on two clean limbs of the unkind
    bench, tuning seeds: 0 of the two with the form free, 1.7 to 60 of an opponent's springs.)
    """
    return step.taken.candidate.effect.filters and step.key[1] in rows.recording.limbs


def _doubted(grown: Grown, step: Step, rows: Rows) -> bool:
    """Whether a limb's step has to be sure of its size with its form free, too.

    Because it `_passes` on motion, or was taken for its share of the misfit alone, by fewer errors:
    an end of range for a sensor that bends (an opponent's). What takes nearly all is no doubt.
    """
    limb = step.key[1] in rows.recording.limbs
    if not limb or not (_passes(step, rows) or step.taken.z < MIN_Z):
        return False
    own = rows.joint_of_block == step.key[1]
    worse = evaluate(grown.model.without(step.taken.candidate), rows).losses[own]
    return not takes_all(worse, grown.score.losses[own])


def _driven(grown: Grown, rows: Rows) -> Step | None:
    """Return the last step that passes on the motion of a limb whose damping is below none."""
    passing = [step for step in grown.steps if _passes(step, rows)]
    if not passing:
        return None
    fits = leave_out(grown.model, rows, grown.score.coefficients)
    for step in reversed(passing):
        value, *each = (
            impedances(grown.model, own)[step.key[1]]["damping"]
            for own in (grown.score.coefficients, *fits.coefficients)
        )
        if fits.interval(np.array(each), value)[1] < 0.0:
            return step
    return None


def determined(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects that may be nothing (`surely_there`), the least sure first.

    What lowers the error is no reason to name a cause as long as its own size does not show it.
    What joints share is judged by its own intervals (`arms.spread`); a load without a mass is none,
    wherever it hangs. Arguments and result are those of `held_in_octaves`.
    """
    return _without(grown, rows, lambda grown: _least_sure(grown, rows), "its size may be zero")


def _least_sure(grown: Grown, rows: Rows) -> Step | None:
    """Return the step whose effect is nearest to nothing; None if all are surely there."""
    for step in grown.steps:
        if _placed(step) and _mass(grown, step) < LEAST_LOAD:
            return step
    own = [step for step in grown.steps if not _shared(step)]
    if not own:
        return None
    sure = {step.key: np.inf for step in own}
    for free in (False, True):
        asked = [step for step in own if not free or _doubted(grown, step, rows)]
        if not asked:
            continue
        fits = leave_out(grown.model, rows, grown.score.coefficients, form_free=free)
        for step in asked:
            candidate = step.taken.candidate
            found = surely_there(fits, grown.model, grown.score.coefficients, candidate)
            sure[step.key] = min(sure[step.key], found)
    least = min(own, key=lambda step: sure[step.key])
    return least if sure[least.key] <= 1.0 else None


def sized(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects of which a size may be far beyond what is possible, and none other is sure.

    They answered something else: a softening that takes more than the whole stiffness beside seven
    pushes that nobody gave, where a stranger's limb met a bump. Arguments and result are those of
    `held_in_octaves`.
    """
    return _without(grown, rows, lambda grown: _unsized(grown, rows), "its size may be any")


def _unsized(grown: Grown, rows: Rows) -> Step | None:
    """Return the last step whose effect has a size that says nothing, and none that is sure."""
    own = [step for step in grown.steps if not _shared(step)]
    if not own:
        return None
    model, coefficients = grown.model, grown.score.coefficients
    fits = leave_out(model, rows, coefficients)
    for step in reversed(own):
        if of_any_size(model, coefficients, fits, step.taken.candidate):
            return step
    return None


def _shared(step: Step) -> bool:
    """Whether a step is what all joints of an arm agree on."""
    return step.key[0] == LINK_INERTIA or _placed(step)


def _placed(step: Step) -> bool:
    """Whether a step is a load that joints share; a limb's may be less than nothing."""
    return step.taken.candidate.effect is PLACED


def _mass(grown: Grown, step: Step) -> float:
    """Return the mass of a load, kg."""
    for term, own in grown.model.split(grown.score.coefficients):
        if term.candidate == step.taken.candidate and 0 in term.kept:
            return float(own[term.kept.index(0)])
    return 0.0


def _without(
    grown: Grown, rows: Rows, failing: Callable[[Grown], Step | None], why: str
) -> tuple[Grown, tuple[str, ...]]:
    """Take out what fails, fitting the others anew each time, and say so."""
    notes: list[str] = []
    while (gone := failing(grown)) is not None:
        candidate = gone.taken.candidate
        where = rows.recording.name(candidate.joint)
        notes.append(f"{candidate.effect.name} of {where} is not added: {why}")
        model = grown.model.without(candidate)
        before, left = grown, tuple(step for step in grown.steps if step is not gone)
        grown = _with_simpler(Grown(model, evaluate(model, rows), left), candidate, rows)
        grown, unmissed = _without_unmissed(grown, before, candidate.joint, rows)
        notes += unmissed
    return grown, tuple(notes)


def _without_unmissed(
    grown: Grown, before: Grown, joint: int, rows: Rows
) -> tuple[Grown, list[str]]:
    """Take out what a joint's left-out rows missed only beside an effect that has gone since.

    It made up for what that one did. (A time delay that answered a vibration left a damping of less
    than none behind: an opponent's arm.)
    """
    notes = []
    for step in grown.steps:
        candidate = step.taken.candidate
        if candidate.joint != joint or _shared(step):
            continue
        if not _missed(before, candidate, rows):
            continue
        grown = _chosen_again(grown, candidate, rows)
        if not _missed(grown, candidate, rows):
            model = grown.model.without(candidate)
            left = tuple(other for other in grown.steps if other is not step)
            grown = Grown(model, evaluate(model, rows), left)
            name = f"{candidate.effect.name} of {rows.recording.name(joint)}"
            notes.append(f"{name} is not added: trials that it was not fitted to do not miss it")
    return grown, notes


def _chosen_again(grown: Grown, candidate: Candidate, rows: Rows) -> Grown:
    """Choose an effect's own parameters anew, which were chosen beside one that has gone.

    (A lag that stood beside a spring was not missed without it, and was the most of what is there.)
    """
    if not candidate.effect.nonlinear:
        return grown
    again = tried_alone(grown.model.without(candidate), rows, candidate)
    return Grown(*again, grown.steps) if again and again[1].sse < grown.score.sse else grown


def _missed(grown: Grown, candidate: Candidate, rows: Rows) -> bool:
    """Whether left-out rows of its joint miss an effect by more than luck, and not too little."""
    own = rows.joint_of_block == candidate.joint
    worse = evaluate(grown.model.without(candidate), rows).losses[own]
    return _better(worse, grown.score.losses[own], rows.fold_of_block[own])


def _better(worse: np.ndarray, better: np.ndarray, folds: np.ndarray) -> bool:
    """Whether some losses of blocks are lower by more than luck, and not by too little."""
    sure = more_than_luck(worse, better, folds, ALONE_Z)
    return sure and compare(worse, better)[0] > MIN_GAIN * float(worse.sum())


def _with_simpler(grown: Grown, gone: Candidate, rows: Rows) -> Grown:
    """Add the first of the simpler effects that one which went contains, if left-out rows miss it.

    That nobody can tell what a joint's friction goes with is no reason to leave it without any.
    """
    for name in gone.effect.includes:
        more = with_missed(grown, Candidate(effect=BY_NAME[name], joint=gone.joint), rows)
        if more is not grown:
            return more
    return grown


def with_missed(grown: Grown, candidate: Candidate, rows: Rows) -> Grown:
    """Add an effect if left-out rows of its joint miss it by more than luck; else as it was."""
    known = grown.model.declared | {other.key for other in grown.model.effects}
    found = None if candidate.key in known else tried_alone(grown.model, rows, candidate)
    if found is None:
        return grown
    model, score = found
    own = rows.joint_of_block == candidate.joint
    worse, better = grown.score.losses[own], score.losses[own]
    if not _better(worse, better, rows.fold_of_block[own]):
        return grown
    gain, error = compare(worse, better)
    taken = Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)
    step = Step(taken=taken, equals=(), options=(), before=float(worse.sum()))
    return Grown(model, score, (*grown.steps, step))


def in_plainest_form(grown: Grown, rows: Rows) -> Grown:
    """Put the simplest of the effects that one contains in its place, if left-out rows allow it.

    A form may have been taken for what was missing beside it then: the cubic of a spring that is
    straight, once a neighbour's friction is found. Friction has a rule of its own
    (`friction.plain_friction`).
    """
    for step in grown.steps:
        candidate = step.taken.candidate
        if candidate.effect.rubs:
            continue
        rest = grown.model.without(candidate)
        known = rest.declared | {other.key for other in rest.effects}
        own = rows.joint_of_block == candidate.joint
        for name in candidate.effect.includes:
            plain = Candidate(effect=BY_NAME[name], joint=candidate.joint)
            found = None if plain.key in known else tried_alone(rest, rows, plain)
            if found is None:
                continue
            model, score = found
            lost, error = compare(score.losses[own], grown.score.losses[own])
            if lost <= error:
                taken = replace(step.taken, candidate=plain, model=model, score=score)
                steps = (replace(s, taken=taken) if s is step else s for s in grown.steps)
                grown = Grown(model, score, tuple(steps))
                break
    return grown


def _rubs_besides(grown: Grown, step: Step) -> bool:
    """Whether a step is damping, and its joint has friction too."""
    candidate = step.taken.candidate
    rubbing = [term.joint for term in grown.model.terms if term.rubs]
    return candidate.effect.name == DAMPING and candidate.joint in rubbing


def _differs(grown: Grown, step: Step, rows: Rows) -> bool:
    candidate = step.taken.candidate
    if not candidate.effect.filters or candidate not in grown.model.effects:
        return False
    return differs_elsewhere(grown.model, candidate, rows)
