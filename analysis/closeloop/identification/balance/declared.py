"""The model as declared: the rigid chain, the declared effects, and the loads that hang from it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import (
    Model,
    Term,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.link_torque import carriers
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Columns, Effect, Theta
from sim.effects.laws.inertia import PLACE, PlacedPayload, load_columns

PLACED = PlacedPayload()
#: Gauss-Newton steps that bring payloads to their places, and when that is done, m.
PLACE_STEPS, PLACE_TOLERANCE = 12, 1e-4
#: Masses of a load that are tried beside the one that those steps lead to, over that.
MASSES = (4.0, 2.0, 0.5, 0.25, 0.125, 1.0 / 16.0, 1.0 / 32.0, 1.0 / 64.0)


def declared_model(recording: Recording, rows: Rows) -> Model:
    """Return the model as declared: rigid chain and unknowns to be fitted.

    Non-linear parameters of declared effects are chosen by the fit, each beside all the others.
    """
    choices: list[list[Term]] = []
    for declared in recording.session.declared:
        joint = recording.device.joints.index(declared.joint)
        if joint not in recording.joints:
            continue
        effect = BY_NAME[declared.effect]
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


def declared_again(model: Model, rows: Rows) -> Model:
    """Return the model with the non-linear parameters of declared effects chosen once more.

    Beside an effect that was found they may be others: friction that seemed to turn late turns at
    once beside the delay.
    """
    recording = model.recording
    for place, term in enumerate(model.terms):
        if term.candidate is not None or term.effect is None or term.load is not None:
            continue
        if term.rubs and any(t.candidate and t.rubs and t.joint == term.joint for t in model.terms):
            # What was found turns with it.
            continue
        best, left = model, evaluate(model, rows).sse
        for scale in (0.0, 1.0, 0.5):
            there = best.terms[place]
            options = _nearby(recording, there, scale)
            if not scale:
                thetas = term.effect.thetas(unfitted(recording, term.joint))
                options = [_declared(recording, term.effect, term.joint, t) for t in thetas]
            if len(options) < 2:
                break
            for option in options:
                terms = list(best.terms)
                terms[place] = replace(option, lower=term.lower, kept=term.kept)
                tried = replace(best, terms=tuple(terms))
                own = evaluate(tried, rows).sse
                if own < left:
                    best, left = tried, own
        model = best
    return model


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


def _load(recording: Recording, load: HungLoad, place: np.ndarray) -> Term:
    """Return a term for a load that trials of the session name, about `place`, m, (3,)."""
    theta, chain = dict(zip(PLACE, place.tolist(), strict=True)), recording.device.model
    return Term(
        effect=PLACED,
        joint=carriers(chain, chain.body(load.body).id)[0],
        columns=_hung(recording, load, theta),
        lower=PLACED.lower,
        theta=theta,
        load=load,
    )


def with_load(model: Model, rows: Rows, load: HungLoad) -> Model:
    """Return a model with a load that trials of its recording name, where the fit says it hangs.

    Its term is the last, unless the others explain its torque. Gravity shows its moments, and only
    inertia, which is quadratic in the place, may show its mass. So steps that begin at the link's
    origin can end at a heavy load near it; other masses with the same moments are tried too.
    """

    def at(place: np.ndarray) -> Model:
        return with_independent(model, _load(model.recording, load, place), rows)

    found = placed(at(np.zeros(3)), rows)
    if len(found.terms) == len(model.terms):
        return found
    left = evaluate(found, rows).sse
    tried = [(evaluate(one, rows).sse, one) for one in map(at, _other_places(found, rows))]
    least, nearest = min(tried, key=lambda pair: pair[0], default=(left, found))
    if least < left:
        moved = placed(nearest, rows)
        if evaluate(moved, rows).sse < left:
            return moved
    return found


def _other_places(model: Model, rows: Rows) -> Iterator[np.ndarray]:
    """Yield where the last load of a model would hang with other masses and the same moments."""
    *_, (term, own) = model.split(evaluate(model, rows).coefficients)
    values = dict(zip(term.kept, own.tolist(), strict=True))
    reach = model.recording.reach(term.joint)
    place = np.array([term.theta[name] for name in PLACE]) + PLACED.way(values)
    for factor in MASSES:
        if 0.0 < float(np.linalg.norm(place)) / factor <= reach:
            yield place / factor


def placed(model: Model, rows: Rows) -> Model:
    """Return the model with every payload where the fit says it hangs, by Gauss-Newton."""
    for _ in range(PLACE_STEPS):
        longest = 0.0
        terms = []
        for term, own in model.split(evaluate(model, rows).coefficients):
            if isinstance(term.effect, PlacedPayload):
                step = term.effect.way(dict(zip(term.kept, own.tolist(), strict=True)))
                longest = max(longest, float(np.linalg.norm(step)))
                term = _moved_by(model.recording, term, step)
            terms.append(term)
        if longest < PLACE_TOLERANCE:
            break
        model = replace(model, terms=tuple(terms))
    return model


def _moved_by(recording: Recording, term: Term, step: np.ndarray) -> Term:
    """Return the term of a payload that hangs `step` further along, m, (3,)."""
    assert term.effect is not None
    theta = {name: term.theta[name] + float(way) for name, way in zip(PLACE, step, strict=True)}
    if term.load is None:
        columns = term.effect.columns(unfitted(recording, term.joint), theta)
        return replace(term, theta=theta, columns=columns)
    return replace(term, theta=theta, columns=_hung(recording, term.load, theta))


def _hung(recording: Recording, load: HungLoad, theta: Theta) -> Columns:
    """Return the columns of a declared load: nothing in the trials that do not name it."""
    body = recording.device.model.body(load.body).id
    carried = [trial.payload == load for trial in recording.session.trials]
    there = np.array(carried)[recording.trial][:, None]
    place = np.array([theta[name] for name in PLACE])
    return {joint: own * there for joint, own in load_columns(recording, body, place).items()}
