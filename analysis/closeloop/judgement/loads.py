"""Trials that carry something the others do not, though nobody said so.

A log with a tool or a weight in the hand, among logs without, leaves a torque that no effect of the
robot explains. It is looked for as if the trial had named a payload (Swevers, Verdonck and De
Schutter 2007 identify a load from what it adds to the bare arm's torque), and the user is asked.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.shared import sure
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.declared import PLACED, with_load
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.findings import Carried, Trace
from analysis.closeloop.identification.selection import LEAST_BLOCKS
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.inertia import PLACE
from sim.effects.parameter import Values

#: Share of what is left of a trial that a load must take away: most of it.
MOST = 0.5
#: Of a load's torque, the columns of its mass and its first moments: the others are small.
MOMENTS = 4
#: By how much a joint's error may grow, by chance, where joints share a load.
WORSE = 0.01


def unnamed_loads(trace: Trace) -> tuple[Carried, ...]:
    """Return the loads that trials seem to carry without naming one, one a trial at most.

    Only a robot of several joints shows a load apart from a wrong gain; held-out trials are looked
    at too, since nothing is fitted to them because of it.
    """
    recording = trace.rows.recording
    trials = recording.session.trials
    if len(recording.joints) < 2 or recording.limbs or len(trials) < 2:
        return ()
    rows = _every_row(trace.rows, recording)
    if rows is None:
        return ()
    model, coefficients = trace.fits[1]
    left = model.target(rows) - model.base(rows)[0] @ coefficients
    found = []
    for body, name in _last_links(recording):
        torque = recording.link_torque(body)
        columns = {joint: torque[:, joint, :MOMENTS] for joint in recording.joints}
        load = rows.stack(model.transformed(columns), MOMENTS)
        for number in np.unique(rows.trial).tolist():
            if trials[number].payload is None and _shows(left, load, rows, number):
                found.append(_carried(model, trace.rows, number, name))
    best: dict[int, Carried] = {}
    for one in found:
        if one is not None and one.share > best.get(one.trial, one).share - 1e-12:
            best[one.trial] = one
    return tuple(best[number] for number in sorted(best))


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


def _shows(left: np.ndarray, load: np.ndarray, rows: Rows, number: int) -> bool:
    """Whether mass and first moments at a link take most of what the model leaves of a trial.

    Every other second is predicted from the ones between; no joint may be worse.

    Args:
        left: residual of every row, (r,).
        load: what one unit of mass and of the moments takes, (r, 4).
        rows: of all trials.
        number: of the trial.
    """
    own = np.flatnonzero(rows.trial == number)
    blocks, place = np.unique(rows.block[own], return_inverse=True)
    if len(blocks) < LEAST_BLOCKS:
        return False
    joint, half = rows.joint_of_block[blocks], blocks % 2
    residual, columns = left[own], load[own]
    after = np.zeros(len(own))
    for out in (0, 1):
        inside = half[place] == out
        fit = np.linalg.lstsq(columns[~inside], residual[~inside], rcond=1e-9)[0]
        if fit[0] <= 0.0:
            return False
        after[inside] = residual[inside] - columns[inside] @ fit
    worse, better = np.bincount(place, residual**2), np.bincount(place, after**2)
    if worse.sum() - better.sum() <= MOST * worse.sum() or not sure(worse, better, half):
        return False
    by_joint = np.bincount(joint, worse), np.bincount(joint, better)
    return bool(np.all(by_joint[1] <= (1.0 + WORSE) ** 2 * by_joint[0]))


def _last_links(recording: Recording) -> Iterator[tuple[int, str]]:
    """Yield number and name of the links that carry no other: what a hand holds hangs there."""
    model, links = recording.device.model, links_of(recording)
    carry = set()
    for body in links.bodies:
        parent = int(model.body_parentid[body])
        while parent > 0:
            carry.add(parent)
            parent = int(model.body_parentid[parent])
    for body, name in zip(links.bodies, links.names, strict=True):
        if body not in carry:
            yield body, name


def _carried(model: Model, fitted: Rows, number: int, body: str) -> Carried | None:
    """Return the load of a trial as it would be fitted if it were named; None if there is none."""
    load = HungLoad(name=f"of trial {number + 1}", body=body)
    session = fitted.recording.session
    trials = list(session.trials)
    trials[number] = replace(trials[number], payload=load)
    recording = replace(fitted.recording, session=replace(session, trials=tuple(trials)))
    rows = _every_row(fitted, recording)
    assert rows is not None
    bare = replace(model, recording=recording)
    loaded = with_load(bare, rows, load)
    if loaded.terms[-1].load != load:
        return None
    mass, *place = _values(loaded, rows, load).values()
    reach = recording.reach(loaded.terms[-1].joint)
    if mass <= 0.0 or float(np.linalg.norm(place)) > reach:
        return None
    felt = [way if n in loaded.terms[-1].kept else None for n, way in enumerate(place, start=1)]
    own = np.unique(rows.block[rows.trial == number])
    losses = [float(evaluate(each, rows).losses[own].sum()) for each in (bare, loaded)]
    x, y, z = felt
    share = 1.0 - losses[1] / losses[0]
    return Carried(trial=number, body=body, mass=mass, position=(x, y, z), share=share)


def _values(model: Model, rows: Rows, load: HungLoad) -> Values:
    """Return mass and place of a load: beside it the links are free again, if they were fitted.

    They hold a part of it where the trial was fitted as if it carried nothing.
    """
    fit = WholeFit(replace(model, given=None), rows, links_of(model.recording))
    every = range(len(model.terms))
    scored = fit.with_links if model.given is not None else fit.alone
    coefficients = scored(every).coefficients
    for term, own in model.split(coefficients):
        if term.load == load:
            columns = dict.fromkeys(range(MOMENTS), 0.0)
            columns |= dict(zip(term.kept, own.tolist(), strict=True))
            readings = PLACED.readings(unfitted(model.recording, term.joint), term.theta)
            if columns[0] <= 0.0:
                break
            return {name: float(reading.of(columns)) for name, reading in readings.items()}
    return {"mass": 0.0, **dict.fromkeys(PLACE, 0.0)}
