"""Try every effect of the catalogue beside a model: the candidates that a name is chosen from."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.channels import best_channel, between
from analysis.closeloop.identification.balance.least_squares import keep_independent
from analysis.closeloop.identification.balance.luck import MIN_GAIN
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_beside,
    estimate_of,
    evaluate,
)
from analysis.closeloop.identification.balance.regression import (
    ROUNDING,
    Rows,
    Score,
    Variant,
    compare,
    score,
)
from analysis.closeloop.identification.balance.searched import searched
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Option
from analysis.closeloop.identification.nameable import (
    beyond_physics,
    corrects,
    drives,
    lowest,
    one_way,
    refusal,
    refused_yet,
)
from analysis.closeloop.identification.springs import (
    ELASTIC,
    FREED,
    begins_of,
    nearest_of_limb,
    of_limb,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import EFFECTS, OF_ROBOTS
from sim.effects.effect import Theta
from sim.effects.laws.loose_link import BEHIND
from sim.effects.motion import Estimate, RecordedJoint

#: Steps of parameters in turn; those that are always made, and the least share of the misfit that
#: one has to take away for a finer one to follow. (The last three, and when they are made, were set
#: while looking at limb 533 of the unkind bench, reporting seeds.)
REFINEMENTS = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.015)
COARSE, SETTLED = 4, 0.01
#: Non-linear parameters of how friction passes through zero.
TURNING = ("smooth",)
#: Options that are refined before they are compared.
CONTENDERS = 6


def candidates(recording: Recording) -> list[Candidate]:
    """Return every effect at every joint it can be asked of, simplest first."""
    return [
        Candidate(effect=effect, joint=joint)
        for joint in recording.joints
        for effect in (*EFFECTS, *OF_ROBOTS)
        if effect.applies(recording, joint)
    ]


def options_beside(
    model: Model, rows: Rows, current: Score, tried: Collection[Candidate]
) -> list[Option]:
    """Try candidates beside the model; best first."""
    estimate = estimate_of(model, current.coefficients)
    active = {candidate.key for candidate in model.effects}
    covered = {
        (simple, candidate.joint)
        for candidate in model.effects
        for simple in (*candidate.effect.includes, *candidate.effect.not_beside)
    }
    known = {term.at.key for term in model.terms if term.effect is not None}
    options = []
    for candidate in tried:
        taken = candidate.key in active | covered | model.declared
        if taken or not has_ground(candidate, active | known):
            continue
        if candidate.effect.sided and one_way(rows, candidate.joint):
            continue
        rest = _without_simpler(model, candidate)
        option = _try(rest, rows, candidate, estimate, current, _simpler(model, candidate))
        if option is not None:
            replaced = {c.key for c in model.effects} - {c.key for c in rest.effects}
            options.append(replace(option, replaced=frozenset(replaced)))
    options.sort(key=lambda option: -option.gain)
    return _sharpened(options, rows, current)


def tried_alone(model: Model, rows: Rows, candidate: Candidate) -> tuple[Model, Score] | None:
    """Return the model with an effect of the parameters that fit best; None if it cannot be.

    Args:
        model: without the effect.
        rows: the samples to fit.
        candidate: the effect and its joint.
    """
    current = evaluate(model, rows)
    estimate = estimate_of(model, current.coefficients)
    option = _try(model, rows, candidate, estimate, current, _simpler(model, candidate))
    return None if option is None else refined(option, rows, rounds=2)


def has_ground(candidate: Candidate, present: set[tuple[str, int]]) -> bool:
    """Whether one of the simpler effects that a candidate grows from is there."""
    grows_from = candidate.effect.grows_from
    return not grows_from or any((name, candidate.joint) in present for name in grows_from)


def _sharpened(options: list[Option], rows: Rows, current: Score) -> list[Option]:
    """Refine the foremost options, so that none loses by the grain of its grid.

    And the one that fits best, of which one fold may have taken another point of its grid.
    """
    sharp = []
    closest = min((option.score.sse for option in options), default=0.0)
    for place, option in enumerate(options):
        close = place < CONTENDERS and option.gain > 0.5 * options[0].gain
        if close or option.candidate.effect.has_to_agree or option.score.sse == closest:
            model, scored = refined(option, rows)
            gain, error = compare(current.losses, scored.losses)
            if gain > option.gain:
                option = replace(option, model=model, score=scored, gain=gain, z=gain / error)
                option = replace(option, refused=refused_yet(option.refused, current, scored))
        sharp.append(option)
    physical = [o for o in sharp if not beyond_physics(o.model, o.score, o.candidate)]
    return sorted(physical, key=lambda option: -option.gain)


def _without_simpler(model: Model, candidate: Candidate) -> Model:
    return model.keeping(lambda other: not candidate.replaces(other))


def _simpler(model: Model, candidate: Candidate) -> Theta:
    """Return the non-linear parameters that a simpler form has found already, where both have them.

    Else a richer form would lose to it by the grain of its grid.
    """
    names = {parameter.name for parameter in candidate.effect.nonlinear}
    return {
        name: value
        for term in model.terms
        if term.candidate is not None and candidate.includes(term.candidate)
        for name, value in term.theta.items()
        if name in names
    }


def turning_with(model: Model, candidate: Candidate) -> Theta:
    """Return how friction that is declared at a candidate's joint passes through zero.

    A joint turns in one way: what further friction there is turns with it, or the two would share
    out between them what neither form is.
    """
    if not candidate.effect.rubs:
        return {}
    return {
        name: value
        for term in model.terms
        if term.candidate is None and term.rubs and term.joint == candidate.joint
        for name, value in term.theta.items()
        if name in TURNING
    }


def _turning_alike(thetas: list[Theta], turning: Theta) -> list[Theta]:
    """Return the parameters with a given passage through zero, each once."""
    alike = [{name: turning.get(name, value) for name, value in theta.items()} for theta in thetas]
    return [dict(once) for once in dict.fromkeys(tuple(theta.items()) for theta in alike)]


def _try(
    model: Model,
    rows: Rows,
    candidate: Candidate,
    estimate: Estimate,
    current: Score,
    simpler: Theta | None = None,
    left_out: tuple[int, ...] = (),
) -> Option | None:
    effect = candidate.effect
    joint = RecordedJoint(model.recording, candidate.joint, estimate)
    thetas = _turning_alike(effect.thetas(joint), turning_with(model, candidate))
    if simpler:
        thetas = [*thetas, *({**theta, **simpler} for theta in thetas)]
        thetas = [dict(once) for once in dict.fromkeys(tuple(t.items()) for t in thetas)]
    found = best_of(model, rows, candidate, thetas, joint, left_out)
    if found is None and effect is ELASTIC and candidate.joint in model.recording.limbs:
        found = best_of(model, rows, candidate, of_limb(model, rows, joint), joint)
    if found is None:
        return None
    if beyond_physics(*found, candidate):
        # Many may fit alike, as a load beside inertia at any distance: which is best is rounding.
        each = (best_of(model, rows, candidate, [theta], joint, left_out) for theta in thetas)
        alike = (one for one in each if one and one[1].sse <= (1.0 + ROUNDING) * found[1].sse)
        found = next((one for one in alike if not beyond_physics(*one, candidate)), found)
    tried, scored = found
    gain, error = compare(current.losses, scored.losses)
    option = Option(
        candidate=candidate,
        model=tried,
        score=scored,
        gain=gain,
        z=gain / error,
        refused=refusal(model, rows, candidate, scored, current),
    )
    # What winds up gives back no more than it has stored.
    rubs = effect.rubs and not effect.winds and not corrects(model, candidate)
    driven = rubs and drives(tried, scored, candidate)
    if not driven and not beyond_physics(tried, scored, candidate):
        return option
    if left_out or not effect.undetermined:
        return None
    # What leaves the physical range may be a column that these trials hardly determine.
    return _try(model, rows, candidate, estimate, current, simpler, effect.undetermined)


def best_of(
    model: Model,
    rows: Rows,
    candidate: Candidate,
    thetas: list[Theta],
    joint: RecordedJoint,
    left_out: tuple[int, ...] = (),
) -> tuple[Model, Score] | None:
    """Return the model with the best variant of an effect, or None if there is none.

    Without the columns that are left out.
    """
    if candidate.effect.channel:
        return best_channel(model, rows, candidate, thetas)
    effect, lower = candidate.effect, lowest(model, candidate)
    base, base_lower = model.base(rows)
    variants = []
    for theta, stacked in _stacked(model, rows, candidate, thetas, joint):
        stacked, kept = _determined(base, stacked, effect.least_own, left_out)
        if kept:
            variants.append(Variant(theta=theta, columns=stacked, kept=kept))
    if not variants:
        return None
    together = [variants]
    if effect.has_to_agree:
        together = [[variant] for variant in variants]
    found = []
    for several in together:
        scored = score(rows, model.target(rows), base, base_lower, several, lower)
        own = scored.coefficients[base.shape[1] :]
        sizes = dict(zip(scored.variant.kept, own.tolist(), strict=True))
        alone = effect.has_to_agree and effect.beyond(joint, scored.variant.theta, sizes)
        if np.any(own) and not alone:
            found.append(scored)
    if not found:
        return None
    scored = min(found, key=lambda one: one.sse)
    term = Term(
        effect=effect,
        joint=candidate.joint,
        columns=effect.columns(joint, scored.variant.theta),
        lower=lower,
        theta=scored.variant.theta,
        kept=scored.variant.kept,
        candidate=candidate,
    )
    return model.with_term(term), scored


def _determined(
    base: np.ndarray, columns: np.ndarray, least: float, left_out: tuple[int, ...]
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Return the columns that are not left out and that nothing before explains, and which."""
    numbers = [number for number in range(columns.shape[1]) if number not in left_out]
    found, kept = keep_independent(base, columns[:, numbers], least)
    return found, tuple(numbers[place] for place in kept)


def _stacked(
    model: Model, rows: Rows, candidate: Candidate, thetas: list[Theta], joint: RecordedJoint
) -> list[tuple[Theta, np.ndarray]]:
    """Return every variant's columns stacked over rows; one pass of the filter."""
    effect = candidate.effect

    def make() -> list[tuple[Theta, np.ndarray]]:
        every = [effect.columns(joint, theta) for theta in thetas]
        if not every:
            return []
        widths = [next(iter(columns.values())).shape[1] for columns in every]
        together = {
            number: np.concatenate([columns[number] for columns in every], axis=1)
            for number in every[0]
        }
        stacked = rows.stack(model.transformed(together), sum(widths))
        ends = np.cumsum(widths)
        return [
            (theta, stacked[:, end - width : end])
            for theta, end, width in zip(thetas, ends, widths, strict=True)
        ]

    if effect.uses_estimate:
        return make()
    grid = tuple(tuple(theta.items()) for theta in thetas)
    found: list[tuple[Theta, np.ndarray]] = rows.once(
        ("variants", candidate.key, grid, model.channel_key), make
    )
    return found


def refined(
    option: Option, rows: Rows, rounds: int = len(REFINEMENTS), *, taken: bool = False
) -> tuple[Model, Score]:
    """Refine the non-linear parameters on all fit rows, within what they can physically be.

    What else a limb's spring may have is for one that is taken: with all it does what loads do.
    """
    candidate, model, current = option.candidate, option.model, option.score
    own = next((term for term in model.terms if term.candidate == candidate), None)
    rest, theta = model.without(candidate), option.theta
    turning = turning_with(rest, candidate)
    left_out = candidate.effect.undetermined
    if own is None or set(left_out) & set(own.kept):
        left_out = ()
    if own is not None and candidate.effect is ELASTIC and BEHIND in theta:
        return _swung(model, current, rows, candidate, FREED if taken else FREED[:1])
    asked = None
    for number, scale in enumerate(REFINEMENTS[:rounds], 1):
        begun = current.sse
        estimate = estimate_beside(model, np.array(current.coefficients), own)
        joint = RecordedJoint(model.recording, candidate.joint, estimate)
        # The same estimate has the same answer.
        if candidate.effect.uses_estimate and own is not None and model is not asked:
            asked = model
            grid = _turning_alike(candidate.effect.thetas(joint), turning)
            again = best_of(rest, rows, candidate, [theta, *grid], joint, left_out)
            if again is not None and again[1].sse < current.sse:
                (model, current), theta = again, again[1].variant.theta
        for near in _turning_alike(candidate.effect.neighbours(theta, scale), turning):
            if near == theta or candidate.effect.beyond(joint, near, {}):
                continue
            found = best_of(rest, rows, candidate, [near], joint, left_out)
            # Not for rounding's sake: it may lead to where the effect cannot be.
            if found is not None and found[1].sse < (1.0 - ROUNDING) * current.sse:
                (model, current), theta = found, near
        if number >= COARSE and current.sse > (1.0 - SETTLED) * begun:
            break
    if candidate.effect.channel:
        model = between(model, rows, candidate, theta, scale)
    least, fewest = current.sse, 0
    for begin, free in candidate.effect.searches(theta) if rounds > COARSE else []:
        near = searched(rest, rows, candidate, joint, begin, free)
        found = best_of(rest, rows, candidate, [near], joint, left_out)
        # What is less simple has to leave less by what would change a number in a report.
        fewest = fewest or len(free)
        most = (1.0 - (MIN_GAIN if len(free) > fewest else 0.0)) * least
        if found is not None and found[1].sse < most and not beyond_physics(*found, candidate):
            model, least = found[0], found[1].sse
    # Coefficients must follow the order of the model's terms.
    return model, evaluate(model, rows)


def _swung(
    model: Model,
    current: Score,
    rows: Rows,
    candidate: Candidate,
    stages: Sequence[tuple[str, ...]],
) -> tuple[Model, Score]:
    """Refine a limb's spring: its parameters together, since one does most of what another does.

    Moved one by one they stopped where the compliance was two thirds of what it is (an opponent's).
    Each share that is freed has to leave less by what would change a number in a report.
    """
    rest, last, taken = model.without(candidate), None, stages[0]
    # At the end up to twice more what was taken: the valley is narrow.
    for free in (*stages, None, None):
        own = next(term for term in model.terms if term.candidate == candidate)
        names = free or taken
        begins = begins_of(own.theta, names) if free else [own.theta]
        theta, joint = nearest_of_limb(
            model, np.array(current.coefficients), own, rows, begins, names
        )
        found = best_of(rest, rows, candidate, [theta], joint)
        least = 1.0 - (MIN_GAIN if free else ROUNDING)
        if found is not None and (last is None or found[1].sse < least * last.sse):
            (model, current), taken, last = found, names, found[1]
        elif not free:
            break
    return model, evaluate(model, rows)
