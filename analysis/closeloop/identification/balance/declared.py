"""The model as declared: the rigid chain, the declared effects, and the loads that hang from it."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from analysis.closeloop.identification.balance.least_squares import inverse_of
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    hung_in,
    link_changes,
    shared_torque,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.session.chain.link_torque import carriers, chain_motion
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms
from sim.effects.catalogue import BY_NAME, law_of
from sim.effects.effect import Columns, Effect, Theta
from sim.effects.laws.inertia import OWN_INERTIA, PLACE, PlacedPayload, load_columns, tells_inertia
from sim.effects.rigid import point_mass

PLACED = PlacedPayload()
ZERO = BY_NAME["position_offset"]
#: Gauss-Newton steps that bring payloads to their places, and when that is done, m.
PLACE_STEPS, PLACE_TOLERANCE = 12, 1e-4
#: What the second beginning has to leave, over what the first leaves: the same place found twice
#: differs by nothing, in digits that no fit should depend on.
LESS = 0.97
#: How far from its link's origin a load is tried first, over its reach.
DISTANCES = tuple(2.0**-n for n in range(8))


def declared_model(recording: Recording, rows: Rows) -> Model:
    """Return the model as declared: rigid chain and unknowns to be fitted.

    Non-linear parameters of declared effects are chosen by the fit, each beside all the others.
    """
    choices: list[list[Term]] = []
    for declared in recording.session.declared:
        joint = recording.device.joints.index(declared.joint)
        if joint not in recording.joints:
            continue
        effect = law_of(declared.effect, of_limb=joint in recording.limbs)
        if not effect.channel:
            thetas = effect.thetas(unfitted(recording, joint))
            choices.append([_declared(recording, effect, joint, theta) for theta in thetas])
    choices = [options for options in choices if options]
    taken = [options[len(options) // 2] for options in choices]

    for scale in (0.0, 1.0, 0.5, 0.25):
        for number, options in enumerate(choices):
            if scale:
                options = [taken[number], *_nearby(recording, taken[number], scale)]
            if len(options) > 1:
                before, after = taken[:number], taken[number + 1 :]
                models = [_joined(recording, [*before, o, *after], rows) for o in options]
                misfits = [evaluate(model, rows).sse for model in models]
                taken[number] = options[int(np.argmin(misfits))]
    model = placed(_joined(recording, taken, rows), rows)
    for load in dict.fromkeys(t.payload for t in recording.session.trials if t.payload is not None):
        model = with_load(model, rows, load)
    return model


def declared_again(
    model: Model,
    rows: Rows,
    misfit: Callable[[Model], float] | None = None,
    *,
    of: int | None = None,
) -> Model:
    """Return the model with the non-linear parameters of declared effects chosen once more.

    Beside an effect that was found they may be others: friction that seemed to turn late turns at
    once beside the delay.

    Args:
        model: with what was found.
        rows: the samples to fit.
        misfit: what a model leaves; of all rows if None.
        of: the joint whose declared effects are chosen; None for all.
    """
    misfit = misfit or (lambda model: evaluate(model, rows).sse)
    recording = model.recording
    for place, term in enumerate(model.terms):
        if term.candidate is not None or term.effect is None or term.load is not None:
            continue
        if of is not None and term.joint != of:
            continue
        if term.rubs and any(t.candidate and t.rubs and t.joint == term.joint for t in model.terms):
            # What was found turns with it.
            continue
        best, left = model, misfit(model)
        for scale in (0.0, 1.0, 0.5):
            there = best.terms[place]
            options = _nearby(recording, there, scale)
            if not scale:
                thetas = term.effect.thetas(unfitted(recording, term.joint))
                options = [_declared(recording, term.effect, term.joint, t) for t in thetas]
            if len(options) < 2:
                break
            for option in options:
                tried = _in_place(best, place, option, rows)
                own = misfit(tried)
                if own < left:
                    best, left = tried, own
        model = best
    return model


def _in_place(model: Model, place: int, option: Term, rows: Rows) -> Model:
    """Return the model with `option` in the place of one of its declared terms.

    The columns that the others leave of it stay the same, unless it has another law: a coupling by
    the other joint's effort has fewer than one by its motion.
    """
    there, terms = model.terms[place], list(model.terms)
    if option.width == there.width:
        terms[place] = replace(option, lower=there.lower, kept=there.kept)
        return replace(model, terms=tuple(terms))
    del terms[place]
    others = replace(model, terms=tuple(terms))
    beside = with_independent(others, option, rows)
    if beside is others:
        return model
    return replace(model, terms=(*terms[:place], beside.terms[-1], *terms[place:]))


def _nearby(recording: Recording, term: Term, scale: float) -> list[Term]:
    """Return a declared effect with its non-linear parameters a little smaller and larger."""
    assert term.effect is not None
    near = term.effect.neighbours(term.theta, scale)
    return [_declared(recording, term.effect, term.joint, theta) for theta in near]


def _declared(recording: Recording, effect: Effect, joint: int, theta: Theta) -> Term:
    columns = effect.columns(unfitted(recording, joint), theta)
    return Term(effect=effect, joint=joint, columns=columns, theta=theta)


def _joined(recording: Recording, terms: list[Term], rows: Rows) -> Model:
    model = Model(recording)
    for term in terms:
        model = with_independent(model, term, rows)
    return model


def naming(recording: Recording, loads: Mapping[int, HungLoad]) -> Recording:
    """Return the recording with trials that name loads, by the trials' numbers."""
    trials = tuple(
        replace(trial, payload=loads.get(number, trial.payload))
        for number, trial in enumerate(recording.session.trials)
    )
    return replace(recording, session=replace(recording.session, trials=trials))


def load_about(recording: Recording, load: HungLoad, place: np.ndarray) -> Term:
    """Return a term for a point mass that trials of the session name, about `place`, m, (3,)."""
    theta, chain = dict(zip(PLACE, place.tolist(), strict=True)), recording.device.model
    columns = hung_columns(recording, load, theta)
    return Term(
        effect=PLACED,
        joint=carriers(chain, chain.body(load.body).id)[0],
        columns={joint: own[:, :OWN_INERTIA] for joint, own in columns.items()},
        lower=PLACED.lower,
        theta=theta,
        load=load,
    )


def with_load(model: Model, rows: Rows, load: HungLoad) -> Model:
    """Return a model with a load that trials of its recording name, where the fit says it hangs.

    Its term is the last, unless the others explain its torque. Gravity shows its moments, and only
    inertia, which is quadratic in the place, may show its mass. So steps that begin at the link's
    origin can end at a heavy load near it, and others begin where a point mass explains most.
    """

    def at(place: np.ndarray) -> Model:
        return with_independent(model, load_about(model.recording, load, place), rows)

    found = placed(at(np.zeros(3)), rows)
    if len(found.terms) == len(model.terms):
        return found
    moved = placed(at(_likeliest(model, rows, load, found.terms[-1].joint)), rows)
    # Where its link's axis goes through the origin no mass is felt there, and none is told.
    less = LESS if 0 in found.terms[-1].kept else 1.0
    best = moved if _misfit(moved, rows) < less * _misfit(found, rows) else found
    return _with_inertia(best, rows)


def _with_inertia(model: Model, rows: Rows) -> Model:
    """Return the model with an inertia of its last load's own, if the rows tell it."""
    *others, point = model.terms
    assert point.load is not None
    before = replace(model, terms=tuple(others))
    load = replace(point, columns=hung_columns(model.recording, point.load, point.theta))
    tried = placed(with_independent(before, load, rows), rows)
    own = tried.terms[-1].kept
    if own != (*point.kept, OWN_INERTIA):
        return model
    fitted, (base, _) = evaluate(tried, rows), tried.base(rows)
    mass = float(fitted.coefficients[-len(own)]) if own[0] == 0 else 0.0
    variance = fitted.sse / len(base) * float(inverse_of(base.T @ base)[-1, -1])
    return tried if tells_inertia(rows.of_one_second * variance, mass) else model


def hung_again(model: Model, rows: Rows) -> Model:
    """Hang every load that trials name anew beside what else the model has now, if less is left.

    Beside the declared chain alone it stood for friction and wrong links in its own trials, too.
    """
    for load in [term.load for term in model.terms if term.load is not None]:
        others = tuple(other for other in model.terms if other.load != load)
        tried = with_load(replace(model, terms=others), rows, load)
        if evaluate(tried, rows).loss < evaluate(model, rows).loss:
            model = tried
    return model


def _misfit(model: Model, rows: Rows) -> float:
    """Return what a model leaves whose last load hangs where it is, and not a way from there."""
    *others, load = model.terms
    there = replace(load, kept=load.kept[:1]) if load.kept[:1] == (0,) else load
    return evaluate(replace(model, terms=(*others, there)), rows).sse


def _likeliest(model: Model, rows: Rows, load: HungLoad, joint: int) -> np.ndarray:
    """Return where a point mass beside a model leaves least, of places all around, m, (3,).

    All of them come out of one matrix: that of the ten inertial parameters of the load's link, less
    what the model's columns take.
    """
    recording = model.recording
    body = recording.device.model.body(load.body).id
    carried = hung_in(recording, load)
    torque = recording.link_torque(body)
    columns = {joint: torque[:, joint] * carried for joint in recording.joints}
    base, _ = model.base(rows)
    both = np.column_stack(
        [rows.stack(model.transformed(columns), torque.shape[2]), model.target(rows)]
    )
    if base.shape[1]:
        both = both - base @ np.linalg.lstsq(base, both, rcond=None)[0]
    gram = both.T @ both
    directions = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    shares = recording.reach(joint) * np.array(DISTANCES)
    places = shares[:, None, None] * directions

    def left(place: np.ndarray) -> float:
        """Return by how much a mass there changes what is left: down, so never above zero."""
        unit = point_mass(place)
        felt = float(unit @ gram[:-1, :-1] @ unit)
        return -(max(float(unit @ gram[:-1, -1]), 0.0) ** 2) / max(felt, 1e-300)

    begun = [min(ring, key=left) for ring in places]
    ends = [minimize(left, place, method="Nelder-Mead") for place in begun]
    return np.asarray(min(ends, key=lambda end: float(end.fun)).x)


def placed(model: Model, rows: Rows) -> Model:
    """Return the model with every payload where the fit says it hangs, by Gauss-Newton.

    And with every wrong zero of a robot where the fit says it is, if it can be there: its torque is
    a secant over the zero itself, of the chain with the links and loads that were found, and far
    beyond that is rounding, which some size makes a torque of (an opponent's UR10: 1e15 rad). A
    gain scales their torque.
    """
    for number in range(PLACE_STEPS):
        longest = 0.0
        terms = []
        fitted = list(model.split(evaluate(model, rows).coefficients))
        hung, shared = link_changes(model, fitted), shared_torque(model, fitted)
        for term, own in fitted:
            if isinstance(term.effect, PlacedPayload):
                step = term.effect.way(dict(zip(term.kept, own.tolist(), strict=True)))
                longest = max(longest, float(np.linalg.norm(step)))
                term = _moved_by(model.recording, term, step)
            elif term.effect is ZERO and term.joint not in model.recording.limbs:
                least, most = ZERO.limits(unfitted(model.recording, term.joint))["offset"]
                offset = float(np.clip(own[0], least, most))
                longest = max(longest, abs(offset - term.theta["offset"]))
                if hung and not number:
                    # Its slope may be that of the chain before anything else was found.
                    longest = np.inf
                term = _zero_at(model.recording, term, offset, hung)
            elif term.effect is not None and term.effect.scales_effort:
                moved, term = _scaling(model.recording, term, shared)
                longest = max(longest, moved)
            terms.append(term)
        if longest < PLACE_TOLERANCE:
            break
        model = replace(model, terms=tuple(terms))
    return model


def _zero_at(
    recording: Recording, term: Term, offset: float, changes: Mapping[int, np.ndarray]
) -> Term:
    """Return a wrong zero of another size: what links and loads that were found take moves, too."""
    joint = term.joint
    columns = dict(ZERO.columns(unfitted(recording, joint), {"offset": offset}))
    if changes and offset:
        there = recording.position.copy()
        there[:, joint] -= offset
        motion = there, recording.velocity, recording.acceleration
        moved = chain_motion(recording.device.model, *motion)
        for body, change in changes.items():
            felt = moved.torque(body, change) - recording.chain.torque(body, change)
            felt /= offset
            columns = {number: own + felt[:, [number]] for number, own in columns.items()}
    return replace(term, theta={"offset": offset}, columns=columns)


def _scaling(recording: Recording, term: Term, shared: np.ndarray) -> tuple[float, Term]:
    """Return by what share a gain's torque is another, with links and loads as found, and the gain.

    Args:
        recording: all trials.
        term: the gain's.
        shared: what links, loads and other joints take, (n, joints).
    """
    assert term.effect is not None
    joint = unfitted(recording, term.joint)
    joint = replace(joint, estimate=replace(joint.estimate, shared=shared))
    columns = term.effect.columns(joint, term.theta)
    before, after = term.columns[term.joint], columns[term.joint]
    return rms(after - before) / max(rms(before), 1e-300), replace(term, columns=columns)


def _moved_by(recording: Recording, term: Term, step: np.ndarray) -> Term:
    """Return the term of a payload that hangs `step` further along, m, (3,)."""
    assert term.effect is not None
    theta = {name: term.theta[name] + float(way) for name, way in zip(PLACE, step, strict=True)}
    if term.load is None:
        columns = term.effect.columns(unfitted(recording, term.joint), theta)
        return replace(term, theta=theta, columns=columns)
    return replace(term, theta=theta, columns=hung_columns(recording, term.load, theta))


def hung_columns(recording: Recording, load: HungLoad, theta: Theta) -> Columns:
    """Return the columns of a declared load: nothing in the trials that do not name it."""
    body = recording.device.model.body(load.body).id
    there = hung_in(recording, load)
    place = np.array([theta[name] for name in PLACE])
    return {joint: own * there for joint, own in load_columns(recording, body, place).items()}
