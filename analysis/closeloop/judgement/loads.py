"""Trials that carry something the others do not, though nobody said so.

Fitted trials are asked before anything else (`identification.loads.carried`). Here what is left of
the others, held-out ones among them, is looked at as if they had named a payload, and the user is
asked.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.closeloop.identification.arms.agreed import MOST, SEVERAL, sure
from analysis.closeloop.identification.arms.links import freed_links, last_links, links_of
from analysis.closeloop.identification.arms.spread import NO_MASS, Spread, mass_and_place
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.declared import with_load
from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.identification.findings import Carried, Trace
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording

#: Of a load's torque, the columns of its mass and its first moments: the others are small.
MOMENTS = 4
#: By how much a joint's error may grow, by chance, where joints share a load.
WORSE = 0.01


def unnamed_loads(trace: Trace) -> tuple[Carried, ...]:
    """Return the loads that trials seem to carry without naming one, one a trial at most.

    Only a robot of several joints shows a load apart from a wrong gain here; held-out trials are
    looked at too, since nothing is fitted to them because of it.
    """
    recording = trace.rows.recording
    trials = recording.session.trials
    if recording.limbs or len(trials) < 2:
        return ()
    rows = _every_row(trace.rows, recording)
    if rows is None:
        return ()
    model, coefficients = trace.fits[1]
    left = model.target(rows) - model.base(rows)[0] @ coefficients
    seen: dict[int, tuple[float, HungLoad]] = {}
    several = len(recording.joints) >= SEVERAL
    for body, name in last_links(recording).items() if several else ():
        torque = recording.link_torque(body)
        columns = {joint: torque[:, joint, :MOMENTS] for joint in recording.joints}
        load = rows.stack(model.transformed(columns), MOMENTS)
        for number in np.unique(rows.trial).tolist():
            share = _share(left, load, rows, number) if trials[number].payload is None else 0.0
            if share > seen.get(number, (0.0,))[0]:
                seen[number] = share, HungLoad(name=f"of trial {number + 1}", body=name)
    # What every trial carries is the robot's own.
    supposed = [n for n, t in enumerate(trials) if t.payload is not None and t.payload.supposed]
    if len(seen) + len(supposed) == len(np.unique(rows.trial)):
        seen = {}
    if not (seen or supposed):
        return ()
    return tuple(sorted(_weighed(model, trace.rows, seen), key=lambda load: load.trial))


def _every_row(fitted: Rows, recording: Recording) -> Rows | None:
    """Return the rows of all trials, joints weighed as in the fit; None if one was not fitted."""
    noise = {
        joint: 1.0 / float(fitted.weight[part.start])
        for joint, part in fitted.parts.items()
        if part.stop > part.start
    }
    if len(noise) < len(recording.joints):
        return None
    trials = tuple(range(len(recording.session.trials)))
    return select_rows(recording, trials).reweighted(noise)


def _share(left: np.ndarray, load: np.ndarray, rows: Rows, number: int) -> float:
    """Return the share of what the model leaves of a trial that a load at a link takes away.

    Every other second is predicted from the ones between. It is 0 unless the load takes most,
    surely, and makes no joint worse.

    Args:
        left: residual of every row, (r,).
        load: what one unit of mass and of the moments takes, (r, 4).
        rows: of all trials.
        number: of the trial.
    """
    own = np.flatnonzero(rows.trial == number)
    blocks, place = np.unique(rows.block[own], return_inverse=True)
    if len(blocks) < LEAST_BLOCKS:
        return 0.0
    joint, half = rows.joint_of_block[blocks], blocks % 2
    residual, columns = left[own], load[own]
    after = np.zeros(len(own))
    for out in (0, 1):
        inside = half[place] == out
        fit = np.linalg.lstsq(columns[~inside], residual[~inside], rcond=1e-9)[0]
        if fit[0] <= 0.0:
            return 0.0
        after[inside] = residual[inside] - columns[inside] @ fit
    worse, better = np.bincount(place, residual**2), np.bincount(place, after**2)
    by_joint = np.bincount(joint, worse), np.bincount(joint, better)
    if np.any(by_joint[1] > (1.0 + WORSE) ** 2 * by_joint[0]) or not sure(worse, better, half):
        return 0.0
    share = 1.0 - float(better.sum() / worse.sum())
    return share if share > MOST else 0.0


def _weighed(
    model: Model, fitted: Rows, seen: Mapping[int, tuple[float, HungLoad]]
) -> Iterator[Carried]:
    """Yield the loads as they would be fitted, all at once, if their trials named them: or are.

    Beside them the links are free again, if they were fitted: they hold a part of a load where its
    trial was fitted as if it carried nothing.
    """
    session = fitted.recording.session
    trials = list(session.trials)
    for number, (_, load) in seen.items():
        trials[number] = replace(trials[number], payload=load)
    recording = replace(fitted.recording, session=replace(session, trials=tuple(trials)))
    rows = _every_row(fitted, recording)
    assert rows is not None
    model = replace(model, recording=recording)
    for _, load in seen.values():
        model = with_load(model, rows, load)
    free = model.given is not None
    links = freed_links(model, links_of(recording))
    fit = WholeFit(replace(model, given=None), rows, links)
    every = range(len(model.terms))
    scored = fit.with_links(every) if free else fit.alone(every)
    spread = Spread(fit, links=free)
    shares = {load.name: share for share, load in seen.values()}
    for place, (term, own) in enumerate(model.split(scored.coefficients)):
        if term.load is None or not (term.load.supposed or term.load.name in shares):
            continue
        value = mass_and_place(model, term, own[None])[0]
        if value[0] <= NO_MASS:
            continue
        carried = Carried(
            trial=0,
            body=term.load.body,
            joint=term.joint,
            value=value,
            half=spread.of_term(place, own, partial(mass_and_place, model, term)),
            moments=value[0] * value[1:],
            half_moments=spread.of_term(place, own, partial(_moments, model, term)),
            felt=term.kept,
            share=term.load.supposed or shares[term.load.name],
            fitted=term.load.supposed > 0.0,
        )
        far = float(np.linalg.norm(value[1:])) > recording.reach(term.joint)
        if carried.fitted or not far or carried.half[0] >= value[0]:
            for number, trial in enumerate(trials):
                if trial.payload == term.load:
                    yield replace(carried, trial=number)


def _moments(model: Model, term: Term, own: np.ndarray) -> np.ndarray:
    """Return the first moments of a payload from some fits of its columns, (fits, 3)."""
    values = mass_and_place(model, term, own)
    return np.asarray(values[:, :1] * values[:, 1:])
