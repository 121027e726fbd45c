"""Intervals of what joints share: the wider of two jackknifes, by parts of time and by joints.

What a model lacks at one joint does not average out over time. The links are fitted anew each time.

Joints know a load by very different shares: the mass on an arm with one joint against gravity rests
on that joint, and what the others say of it alone is noise. A fit without a joint counts by the
information that it keeps (Busing, Meijer and van der Leeden 1999, Delete-m jackknife for unequal
m): its square by h - 1, where 1 / h is the joint's share, and at most as if all had equal ones.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.stats import t

from analysis.closeloop.contract import CONFIDENCE
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Term
from sim.effects.laws.inertia import PLACE

#: Parts of every trial that are left out in turn.
PARTS = 10
#: Joints that are left out in turn, at least: one of two knows a load by half, and a spread of two
#: fits says next to nothing (one degree of freedom).
FEWEST_JOINTS = 3
#: A load of no more is none, kg: its place is a quotient by it.
NO_MASS = 1e-9
#: Step of slopes, over the standard error under white noise.
STEP = 1e-3


class Refitted(Protocol):
    """A whole model that can be fitted without some of its rows."""

    rows: Rows
    #: Number of the term that each coefficient belongs to.
    owner: np.ndarray

    def grams_without(self, clusters: np.ndarray) -> np.ndarray:
        """Return the Gram matrix of all rows without each cluster of them, (clusters, n, n)."""

    def left_out(self, grams: np.ndarray, *, links: bool) -> tuple[np.ndarray, np.ndarray]:
        """Fit every term without each cluster of rows in turn."""

    def covariances(self, grams: np.ndarray, *, links: bool) -> np.ndarray:
        """Return what white noise makes of the terms in all rows, then without each cluster."""


class Spread:
    """The fits of a whole model without each part of time, and without each joint, in turn."""

    def __init__(self, fit: Refitted, *, links: bool) -> None:
        """Fit again without each part; `links`: whether the links are free."""
        self.owner = fit.owner
        without = [fit.grams_without(_times(fit.rows))]
        self.covariances: np.ndarray | None = None
        if len(fit.rows.joints) >= FEWEST_JOINTS:
            without.append(fit.grams_without(fit.rows.joint_of_block[fit.rows.block]))
            self.covariances = fit.covariances(without[-1], links=links)
        self.fits = [fit.left_out(grams, links=links) for grams in without]

    def of_term(
        self, number: int, own: np.ndarray, read: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return half of the 90 % interval of what is read off one term, (q,).

        Args:
            number: of the term.
            own: its coefficients, (n,).
            read: makes of some fits of them, (fits, n), the quantities, (fits, q).
        """
        columns = self.owner == number
        every = [read(fits[:, columns]) for fits, _ in self.fits]
        if self.covariances is None:
            return self.half_width(read(own[None])[0], every)
        known = self.covariances[:, columns][:, :, columns]
        steps = STEP * np.sqrt(known[0].diagonal())
        slope = (read(own + np.diag(steps)) - read(own - np.diag(steps))) / (2 * steps[:, None])
        noise = np.einsum("iq,gij,jq->gq", slope, known, slope)
        left = noise[0] / np.maximum(noise, 1e-300)[1:]
        return self.half_width(read(own[None])[0], every, left)

    def half_width(
        self, found: np.ndarray, every: list[np.ndarray], left: np.ndarray | None = None
    ) -> np.ndarray:
        """Return half of the 90 % interval of some quantities.

        Args:
            found: the quantities, any shape.
            every: what they are without each cluster, one array of (clusters, ...) a partition.
            left: share of the information on each that is left without each joint, (joints, ...);
                without it all count alike.
        """
        half = np.zeros_like(found)
        for number, without in enumerate(every):
            count = len(without)
            counted = np.full_like(without, count - 1.0)
            if number > 0 and left is not None:
                counted = np.minimum(counted, left / np.maximum(1.0 - left, 1e-9))
            variance = (counted * (without - found) ** 2).sum(axis=0) / count
            quantile = float(t.ppf((1 + CONFIDENCE) / 2, count - 1))
            half = np.maximum(half, quantile * np.sqrt(variance))
        return half


def mass_and_place(model: Model, term: Term, own: np.ndarray) -> np.ndarray:
    """Return mass and place of a payload from some fits of its columns, (fits, 4)."""
    values = dict(zip(term.kept, own.T, strict=True))
    values = {number: values.get(number, np.zeros(len(own))) for number in range(4)}
    values[0] = np.maximum(values[0], NO_MASS)
    readings = PLACED.readings(unfitted(model.recording, term.joint), term.theta)
    return np.column_stack([np.asarray(readings[name].of(values)) for name in ("mass", *PLACE)])


def _times(rows: Rows) -> np.ndarray:
    """Return each row's part of its trial, (r,)."""
    recording = rows.recording
    clock = np.concatenate([recording.time[own] for own in rows.samples.values()])
    found = np.zeros(len(clock), dtype=int)
    for number in np.unique(rows.trial):
        own = rows.trial == number
        low, high = clock[own].min(), clock[own].max()
        part = (clock[own] - low) / max(high - low, 1e-300) * PARTS
        found[own] = np.minimum(part.astype(int), PARTS - 1)
    return found
