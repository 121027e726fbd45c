"""Held-out trials that carry something else than the fitted ones, though nobody said so.

What every fitted trial carries is the robot's own, until a held-out trial is predicted far better
without it. And a held-out trial may carry what one of the fitted ones does. Nothing is fitted to a
held-out trial for that: what was fitted is compared with it as it may hang there, or not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.agreed import MOST, SEVERAL, WORSE, sure
from analysis.closeloop.identification.arms.links import Links, last_links, links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import weighed_by
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit
from analysis.closeloop.identification.balance.declared import (
    declared_model,
    hung_columns,
    naming,
)
from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording


def supposing_held_out(recording: Recording) -> Recording:
    """Return the recording with the loads named that tell held-out trials from fitted ones.

    A load of every fitted trial, if a held-out one is predicted by less than half of its squared
    error without it, or one of some fitted trials that a held-out one seems to carry, too.
    """
    trials = recording.session.trials
    held = [n for n, t in enumerate(trials) if t.role == "holdout" and t.payload is None]
    if len(recording.joints) < SEVERAL or recording.limbs or not held:
        return recording
    hung = [trials[n].payload for n in recording.fit_trials]
    if all(load is None or load.supposed for load in hung):
        recording = _bare(recording, held)
    if any(t.payload is not None and t.payload.supposed for t in recording.session.trials):
        recording = _alike(recording, held)
    return recording


def _bare(recording: Recording, held: Sequence[int]) -> Recording:
    """Name what all fitted trials carry, if a held-out one is far better predicted without it."""
    fit, rows, links = _fitted(recording)
    every = range(len(fit.model.terms))
    last = last_links(recording)
    loads = [load for load in fit.loads() if links.bodies[load.link or 0] in last]
    if not loads:
        return recording
    load = min(loads, key=lambda load: load.loss)
    assert load.link is not None
    supposed = 0.0
    for number in held:
        there = _held_out(fit.model, rows, links, number)
        if there is not None:
            all_carry = [fit.alone(every), fit.with_links(every), load]
            bare = replace(load, links=np.zeros_like(load.links))
            supposed = max(supposed, _better(there, all_carry, bare))
    if not supposed:
        return recording
    name = "of every fitted trial"
    own = HungLoad(name=name, body=links.names[load.link], supposed=supposed)
    trials = recording.session.trials
    return naming(recording, {n: trials[n].payload or own for n in recording.fit_trials})


def _alike(recording: Recording, held: Sequence[int]) -> Recording:
    """Name in a held-out trial the load of fitted ones, if that predicts it far better."""
    fit, rows, links = _fitted(recording)
    every = range(len(fit.model.terms))
    fits = [fit.alone(every), fit.with_links(every)]
    found: dict[int, HungLoad] = {}
    for number in held:
        there = _held_out(fit.model, rows, links, number)
        if there is None:
            continue
        shares: dict[HungLoad, float] = {}
        for load in [term.load for term in fit.model.terms if term.load and term.load.supposed]:
            hung = naming(recording, {number: load})
            other = _held_out(_hung_in(fit.model, hung, load), rows, links, number)
            assert other is not None
            shares[load] = max(_better(there, fits, own, other) for own in fits)
        best = max(shares, key=shares.__getitem__)
        if shares[best]:
            found[number] = best
    return naming(recording, found)


def _fitted(recording: Recording) -> tuple[WholeFit, Rows, Links]:
    """Return fits to the fitted trials, beside plain friction and the loads that are supposed."""
    rows = select_rows(recording, recording.fit_trials)
    model = with_ordinary(declared_model(recording, rows), rows)
    rows, links = weighed_by(model, rows), links_of(recording)
    return WholeFit(model, rows, links), rows, links


def _held_out(model: Model, fitted: Rows, links: Links, number: int) -> WholeFit | None:
    """Return the model's columns in a held-out trial, joints weighed as in the fit."""
    rows = select_rows(model.recording, (number,))
    noise = {
        joint: 1.0 / float(fitted.weight[part.start])
        for joint, part in fitted.parts.items()
        if part.stop > part.start
    }
    if len(rows.block) == 0 or not set(rows.joints) <= noise.keys():
        return None
    if int(rows.block.max()) + 1 < LEAST_BLOCKS:
        return None
    return WholeFit(model, rows.reweighted(noise), links)


def _hung_in(model: Model, recording: Recording, load: HungLoad) -> Model:
    """Return the model where another recording says that its load hangs."""
    terms = []
    for term in model.terms:
        if term.load == load:
            term = replace(term, columns=hung_columns(recording, load, term.theta))
        terms.append(term)
    return replace(model, recording=recording, terms=tuple(terms))


def _better(
    there: WholeFit, before: Sequence[Fitted], after: Fitted, other: WholeFit | None = None
) -> float:
    """Return the part of what the best of some fits leaves of a trial that another one takes away.

    0 unless it takes most of it at several joints, surely, and makes none worse.

    Args:
        there: the columns in the trial.
        before: fits to other trials.
        after: another.
        other: the columns that belong to it; the same if None.
    """
    rows = there.rows
    worse = min((_losses(there, fitted) for fitted in before), key=np.sum)
    better = _losses(other or there, after)
    left, still = (np.bincount(rows.joint_of_block, own) for own in (worse, better))
    if np.any(still > (1.0 + WORSE) ** 2 * left):
        return 0.0
    if np.sum(still < (1.0 - MOST) * left) < SEVERAL:
        return 0.0
    if not sure(worse, better, rows.fold_of_block):
        return 0.0
    return 1.0 - float(still.sum() / left.sum())


def _losses(there: WholeFit, fitted: Fitted) -> np.ndarray:
    """Return the squares over every block that a fit to other trials leaves, (blocks,)."""
    found = np.concatenate([fitted.coefficients, fitted.links.ravel()])
    left = there.table[:, -1] - there.table[:, :-1] @ found
    return np.bincount(there.rows.block, left**2)
