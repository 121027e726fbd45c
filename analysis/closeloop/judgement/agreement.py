"""What explanations that the trials cannot tell apart say alike of a stiffness.

A name is chosen among equals by what is simplest, which says nothing of how far it moves K: where
nothing pulls at a joint a gain, an inertia and a payload are one torque, and only K differs. So a
repair moves a stiffness only as far as all of them do: by the name that moves it least, and not at
all where they disagree on which way. Then K gets no worse if one of them is true: what is
identified is the set of values that no explanation rules out (Manski 2003, Partial Identification
of Probability Distributions).
"""

from collections.abc import Iterator
from dataclasses import replace

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.luck import predicts_as_well
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_of,
    evaluate,
    impedances,
)
from analysis.closeloop.identification.balance.regression import ROUNDING, Rows, Score, compare
from analysis.closeloop.identification.balance.searched import searched
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.candidates import best_of
from analysis.closeloop.identification.findings import Option, Step, Trace, exchanged
from analysis.closeloop.identification.nameable import beyond_physics
from analysis.closeloop.identification.parameters import of_sure_size
from sim.effects.effect import Limits, Theta
from sim.effects.motion import RecordedJoint

#: Stiffnesses under two names that differ by less than this share are one.
APART = 0.02
DISAGREE = (
    "the names that explain these trials alike move the stiffness of {} different ways, so it "
    "stays as declared and nothing is repaired"
)


def alternatives(found: Trace) -> Iterator[tuple[Step, Option]]:
    """Yield every other name that explains the trials about as well, fitted in its step's place."""
    model, _ = found.fit_of_steps
    for step in found.steps:
        for option in step.equals:
            other = exchanged(model, step.taken, option)
            yield step, replace(option, model=other, score=evaluate(other, found.rows))


def other_forms(found: Trace) -> Iterator[tuple[tuple[str, int], Model, Score]]:
    """Yield other forms of what was found that predict these trials as well, fitted in its place.

    Each with the effect's name and what makes the form, as a power that is chosen, and its joint.
    """
    model, coefficients = found.fit_of_steps
    for term, own in model.split(coefficients):
        if term.candidate is None:
            continue
        effect, rest = term.candidate.effect, model.without(term.candidate)
        joint = RecordedJoint(model.recording, term.joint, estimate_of(model, coefficients))
        choices = {name for name, parameter in effect.parameters.items() if parameter.choice}
        sizes = dict(zip(term.kept, own.tolist(), strict=True))
        others: list[tuple[Theta, Limits]] = [(one, {}) for one in effect.forms(term.theta, sizes)]
        for begin, free in [*effect.searches(term.theta), *others]:
            chosen = {
                name: value
                for name, value in begin.items()
                if name in choices and value != term.theta.get(name)
            }
            if not chosen:
                continue
            near = begin
            if free:
                near = searched(rest, found.rows, term.candidate, joint, begin, free)
            other = best_of(rest, found.rows, term.candidate, [near], joint)
            if other is None or beyond_physics(*other, term.candidate):
                continue
            score = evaluate(other[0], found.rows)
            # Of two that fit the same but for rounding one may lose more than its error by it.
            same = abs(score.sse - found.score.sse) <= ROUNDING * found.score.sse
            if same or predicts_as_well(score, found.score):
                said = ", ".join(f"{name} {value:g}" for name, value in chosen.items())
                yield (f"{effect.name} ({said})", term.joint), other[0], score


def agreed(found: Trace) -> Trace:
    """Return the trace with a stiffness moved no further than equal names move it alike."""
    if found.verdict != Verdict.EFFECT_FOUND:
        return found
    declared, repaired = (impedances(*fit) for fit in found.fits)
    sure = {
        step.key: _sure(found.model, found.score, step.taken.candidate, found.rows)
        for step in found.steps
        if step.equals
    }
    rivals = [
        (step, o)
        for step, o in alternatives(found)
        if predicts_as_well(o.score, found.score)
        and (not sure[step.key] or _sure(o.model, o.score, o.candidate, found.rows))
    ]
    stiff = [impedances(o.model, o.score.coefficients) for _, o in rivals]
    for joint, own in repaired.items():
        values = [own["stiffness"], *(other[joint]["stiffness"] for other in stiff)]
        before = declared[joint]["stiffness"]
        least = min(range(len(values)), key=lambda number: abs(values[number] - before))
        if max(values) - min(values) <= APART * abs(values[0]):
            continue
        if min(values) < before < max(values) or (least and rivals[least - 1][1].refused):
            return _withheld(found, found.rows.recording.name(joint))
        if abs(values[least] - values[0]) > APART * abs(values[0]):
            return _under(found, *rivals[least - 1])
    return found


def _sure(model: Model, score: Score, candidate: Candidate, rows: Rows) -> bool:
    """Whether an effect's size can be told; a load that may be none takes no gain's place."""
    return of_sure_size(
        model, score.coefficients, leave_out(model, rows, score.coefficients), candidate
    )


def _withheld(found: Trace, joint: str) -> Trace:
    """Return the trace with its names, and without its repair."""
    return replace(
        found,
        verdict=Verdict.NOT_IDENTIFIABLE,
        model=found.declared,
        score=found.declared_score,
        supposed=found.fits[1],
        explainable_after=found.explainable_before,
        notes=(*found.notes, DISAGREE.format(joint)),
    )


def _under(found: Trace, step: Step, option: Option) -> Trace:
    """Return the trace with another name of a step as the one taken."""
    rest = (other for other in step.equals if other.candidate != option.candidate)
    again = replace(step, taken=option, equals=(step.taken, *rest))
    steps = [again if one is step else one for one in found.steps]
    for candidate in option.beside:
        without = evaluate(option.model.without(candidate), found.rows)
        gain, error = compare(without.losses, option.score.losses)
        taken = replace(option, candidate=candidate, gain=gain, z=gain / error, beside=())
        steps.append(Step(taken=taken, equals=(), options=(), before=without.loss))
    return replace(found, model=option.model, score=option.score, steps=tuple(steps))
