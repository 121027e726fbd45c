"""Fits of all joints together: every term of a model, and what the joints share.

One Gram matrix per fold holds every column, so that a model without a term is a part of it and each
question costs one small solve (a fold). The links enter by `links.fit_links`, a payload by its mass
and the place that it hangs at.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.closeloop.identification.arms.links import PARAMETERS, Links, curvature, fit_links
from analysis.closeloop.identification.balance.declared import (
    PLACE_STEPS,
    PLACE_TOLERANCE,
    PLACED,
)
from analysis.closeloop.identification.balance.least_squares import (
    gram_matrices,
    inverse_of,
    solve,
    sums_of_others,
)
from analysis.closeloop.identification.balance.model import Model, unfitted, with_independent
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import (
    Candidate,
    Given,
    Term,
    kept_columns,
)
from analysis.closeloop.session.chain.link_torque import carriers
from sim.effects.laws.inertia import (
    LEAST_LOAD,
    MOST_LOAD,
    OWN_INERTIA,
    PLACE,
    LinkInertia,
    load_parameters,
    tells_inertia,
)

LINKS = LinkInertia()
#: How much more than one second's rows the declared links may count, firmest first.
STRENGTHS = (100.0, 10.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A fit to all rows, and what it loses on rows it was not fitted to."""

    #: Of every column of the model, zero where a term was left out, (p,).
    coefficients: np.ndarray
    #: Change of the parameters of every link, (links, 10); zero where they were not free.
    links: np.ndarray
    #: Held-out residual of every row, (r,), and its square over every block, (blocks,).
    left: np.ndarray
    losses: np.ndarray
    #: Number of the link that carries a payload, its place, its mass, and the columns of a load
    #: that the rows tell.
    link: int | None = None
    place: np.ndarray | None = None
    mass: float = 0.0
    told: tuple[int, ...] = ()

    @property
    def loss(self) -> float:
        return float(self.losses.sum())


class WholeFit:
    """A model's columns over all rows, with those of the links, and their Gram matrices."""

    def __init__(
        self, model: Model, rows: Rows, links: Links, *, strength: float | None = None
    ) -> None:
        """Prepare fits; `strength`: how firmly links stay as declared, if that is known."""
        if strength is not None:
            self.strength = strength
        self.model, self.rows, self.links = model, rows, links
        parts = [rows.stack(model.transformed(kept_columns(t)), len(t.kept)) for t in model.terms]
        #: Which term each column is of, (p,).
        self.owner = np.repeat(np.arange(len(parts)), [part.shape[1] for part in parts])
        self.lower = model.base(rows)[1]
        self.size = len(self.owner)
        self.table = np.column_stack([*parts, link_rows(model, rows, links), model.target(rows)])
        self.grams = gram_matrices(self.table, rows.folds)
        self.total = self.grams.sum(axis=0)

    @cached_property
    def strength(self) -> float:
        """How firmly links stay as declared: the firmest that left-out groups do not mind.

        In units of the rows of one second and joint, as if these were one observation.
        """
        second = self.rows.of_one_second
        every = np.arange(self.size)
        tried = [self._with_links(every, second * times) for times in STRENGTHS]
        best = min(tried, key=lambda fitted: fitted.loss)
        for times, fitted in zip(STRENGTHS, tried, strict=True):
            lost, error = compare(fitted.losses, best.losses)
            if lost <= error:
                return second * times
        return second * STRENGTHS[-1]

    def columns_of(self, terms: Sequence[int]) -> np.ndarray:
        """Return the numbers of the columns of some terms."""
        return np.flatnonzero(np.isin(self.owner, list(terms)))

    def alone(self, terms: Sequence[int]) -> Fitted:
        """Fit some terms with the links as they are declared."""
        index = self.columns_of(terms)
        both = np.append(index, self.table.shape[1] - 1)
        return self._scored(index, lambda gram: solve(gram[np.ix_(both, both)], self.lower[index]))

    def with_links(self, terms: Sequence[int]) -> Fitted:
        """Fit some terms and the inertial parameters of all links."""
        return self._with_links(self.columns_of(terms), self.strength)

    def _with_links(self, index: np.ndarray, strength: float) -> Fitted:
        both = self._beside_links(index)
        return self._scored(both, lambda gram: self._links(gram, index, strength))

    def _beside_links(self, index: np.ndarray) -> np.ndarray:
        return np.concatenate([index, np.arange(self.size, self.table.shape[1] - 1)])

    def _links(self, gram: np.ndarray, index: np.ndarray, strength: float) -> np.ndarray:
        """Fit the columns `index` and all links to a Gram matrix."""
        both = self._beside_links(index)
        lower = self.lower[index]
        square, moments = gram[np.ix_(both, both)], gram[both, -1]
        return fit_links(square, moments, self.links.pseudo, strength, lower)

    def grams_without(self, clusters: np.ndarray) -> np.ndarray:
        """Return the Gram matrix of all columns and the target without each cluster of rows.

        Args:
            clusters: number of each row's, (r,).

        Returns:
            One matrix per cluster, (clusters, n, n).
        """
        parts = [np.flatnonzero(clusters == number) for number in np.unique(clusters)]
        return sums_of_others(gram_matrices(self.table, parts))

    def left_out(self, grams: np.ndarray, *, links: bool) -> tuple[np.ndarray, np.ndarray]:
        """Fit every term without each cluster of rows in turn.

        Args:
            grams: without each (`grams_without`).
            links: whether the links are free.

        Returns:
            Coefficients, (clusters, p), and the changes of the links, (clusters, links, 10).
        """
        every = np.arange(self.size)
        both = np.append(every, self.table.shape[1] - 1)
        coefficients, changes = [], []
        for gram in grams:
            if links:
                found = self._links(gram, every, self.strength)
            else:
                own = solve(gram[np.ix_(both, both)], self.lower)
                found = np.concatenate([own, np.zeros(self.table.shape[1] - 1 - self.size)])
            coefficients.append(found[: self.size])
            changes.append(found[self.size :].reshape(-1, PARAMETERS))
        return np.array(coefficients), np.array(changes)

    def covariances(self, grams: np.ndarray, *, links: bool) -> np.ndarray:
        """Return what white noise of variance one makes of the terms, (1 + clusters, p, p).

        First of the fit to all rows, then without each cluster; arguments as those of `left_out`.
        Free links are held by what is declared of them, as firmly as in the fit.
        """
        width = self.table.shape[1] - 1 if links else self.size
        held = self.strength * self._declared() if links else np.zeros((width, width))
        every = np.array([self.total, *grams])[:, :width, :width] + held
        for gram in every:
            gram[np.diag_indices(width)] += gram.diagonal() == 0.0
        every = inverse_of(every)
        return every[:, : self.size, : self.size]

    def drawn(self, change: np.ndarray) -> tuple[np.ndarray, float]:
        """Return how far what is declared of the links may draw their fit off.

        A ridge's bias (Hoerl and Kennard 1970, Ridge regression), were the links as far from the
        declared ones where no joint feels it as they are found to be where joints do. That is the
        empirical Bayes estimate of how far they may be (Morris 1983, Parametric empirical Bayes
        inference), by as many directions as the rows determine.

        Args:
            change: of the links' parameters, as fitted, (links, 10).

        Returns:
            Covariance of the bias, (10 links, 10 links), and that number of directions.
        """
        declared = self._declared()
        gram = self.total[:-1, :-1] + self.strength * declared
        gram[np.diag_indices(len(gram))] += gram.diagonal() == 0.0
        drawn = self.strength * inverse_of(gram[None])[0]
        own = slice(self.size, None)
        told = change.size - float(np.trace((drawn @ declared)[own, own]))
        moved = change.ravel() @ declared[own, own] @ change.ravel()
        usual = moved / max(told, 1.0)
        return usual * (drawn @ declared @ drawn)[own, own], max(told, 1.0)

    def _declared(self) -> np.ndarray:
        """Return how the divergence from the declared links curves there, over all columns."""
        found = np.zeros((self.table.shape[1] - 1,) * 2)
        for number, own in enumerate(curvature(np.linalg.inv(self.links.pseudo))):
            first = self.size + PARAMETERS * number
            found[first : first + PARAMETERS, first : first + PARAMETERS] = own
        return found

    def with_load(self, terms: Sequence[int], number: int) -> Fitted:
        """Fit some terms and one load on link `number`: where it hangs by all rows.

        Along an axis that they do not tell it stays where the link's own mass is. Else it would
        drift to where its inertia stands for that of a motor.
        """
        own = np.arange(PARAMETERS) + self.size + PARAMETERS * number
        index = self.columns_of(terms)
        place = self.links.declared[number, 1:4] / self.links.declared[number, 0]
        told = self._told(index, own, place, number)
        lower = np.concatenate([self.lower[index], np.array(PLACED.lower)[list(told)]])
        for _ in range(PLACE_STEPS):
            turn = self._turn(index, own, place, told)
            found = solve(turn.T @ self.total @ turn, lower)[len(index) :].tolist()
            step = PLACED.way(dict(zip(told, found, strict=True)))
            place = place + step
            if np.linalg.norm(step) < PLACE_TOLERANCE:
                break
        turn = self._turn(index, own, place, told)

        def fit(gram: np.ndarray) -> np.ndarray:
            return np.asarray(turn[:-1, :-1] @ solve(turn.T @ gram @ turn, lower))

        scored = self._scored(np.arange(self.table.shape[1] - 1), fit)
        mass = float(solve(turn.T @ self.total @ turn, lower)[len(index)])
        return replace(scored, link=number, place=place, mass=mass, told=told)

    def _told(
        self, index: np.ndarray, own: np.ndarray, place: np.ndarray, number: int
    ) -> tuple[int, ...]:
        """Return the columns of a load on link `number` that the rows tell, its mass among them.

        Its place along an axis to better than the arm's reach, then its own inertia beside it; as
        if the rows of one second were one observation.
        """

        def known(asked: Sequence[int]) -> tuple[float, np.ndarray]:
            turn = self._turn(index, own, place, asked)
            gram = turn.T @ self.total @ turn
            mass = float(solve(gram, np.full(len(gram) - 1, -np.inf))[len(index)])
            variance = np.diag(inverse_of(gram[:-1, :-1]))[len(index) :]
            return mass, self.rows.of_one_second * variance

        mass, variance = known((0, 1, 2, 3))
        told = (variance > 0.0) & (np.sqrt(variance) < self.reach(number) * max(mass, LEAST_LOAD))
        kept = (0, *(np.flatnonzero(told[1:]) + 1).tolist())
        mass, variance = known((*kept, OWN_INERTIA))
        return (*kept, OWN_INERTIA) if tells_inertia(float(variance[-1]), mass) else kept

    def reach(self, number: int) -> float:
        """Return how far from the frame of link `number` the arm reaches, m."""
        recording = self.model.recording
        return recording.reach(carriers(recording.device.model, self.links.bodies[number])[0])

    def loads(self) -> list[Fitted]:
        """Fit every term and one load on each link in turn; those that could be a load.

        It has a mass, of which an arm may carry so much, and hangs where the arm could reach.
        """
        every, found = range(len(self.model.terms)), []
        most = MOST_LOAD * self.model.recording.mass
        for number in range(len(self.links.bodies)):
            fitted = self.with_load(every, number)
            assert fitted.place is not None
            if 0.0 < fitted.mass <= most and np.linalg.norm(fitted.place) <= self.reach(number):
                found.append(fitted)
        return found

    def _turn(
        self, index: np.ndarray, own: np.ndarray, place: np.ndarray, told: Sequence[int]
    ) -> np.ndarray:
        """Return what makes of the table's columns those of some terms, a load and the target.

        Of a load about `place` the columns `told`.
        """
        turn = np.zeros((self.table.shape[1], len(index) + len(told) + 1))
        turn[index, np.arange(len(index))] = 1.0
        turn[own, len(index) : -1] = load_parameters(place)[:, list(told)]
        turn[-1, -1] = 1.0
        return turn

    def _scored(self, index: np.ndarray, fit: Callable[[np.ndarray], np.ndarray]) -> Fitted:
        """Fit the Gram matrices without each fold, then all: `fit` gives one per column."""
        residual = np.zeros(len(self.table))
        for fold, gram in zip(self.rows.folds, self.grams, strict=True):
            if len(fold):
                found = fit(self.total - gram)
                residual[fold] = self.table[fold, -1] - self.table[np.ix_(fold, index)] @ found
        every = np.zeros(self.table.shape[1] - 1)
        every[index] = fit(self.total)
        return Fitted(
            coefficients=every[: self.size],
            links=every[self.size :].reshape(-1, PARAMETERS),
            left=residual,
            losses=np.bincount(self.rows.block, residual**2),
        )


def link_rows(model: Model, rows: Rows, links: Links) -> np.ndarray:
    """Return what one unit of every link's parameters asks of the joints, (r, 10 links)."""
    recording = model.recording
    every = [recording.link_torque(body) for body in links.bodies]
    columns = {
        joint: np.concatenate([torque[:, joint] for torque in every], axis=1)
        for joint in recording.joints
        if every
    }
    return rows.stack(model.transformed(columns), PARAMETERS * len(every))


def loaded(model: Model, rows: Rows, links: Links, load: Fitted) -> Model:
    """Add the payload of a fit as a term."""
    assert load.link is not None and load.place is not None
    recording = model.recording
    chain = recording.device.model
    joint = carriers(chain, links.bodies[load.link])[0]
    theta = dict(zip(PLACE, load.place.tolist(), strict=True))
    term = Term(
        effect=PLACED,
        joint=joint,
        columns=PLACED.columns(unfitted(recording, joint), theta),
        lower=PLACED.lower,
        theta=theta,
        candidate=Candidate(effect=PLACED, joint=joint),
    )
    *others, hung = with_independent(model, term, rows).terms
    kept = tuple(column for column in hung.kept if column in load.told)
    return replace(model, terms=(*others, replace(hung, kept=kept)))


def with_links(model: Model, links: Links, change: np.ndarray) -> Model:
    """Give the model the links that a fit found."""
    recording = model.recording
    torque = {
        joint: sum(
            (
                recording.link_torque(body)[:, joint] @ own
                for body, own in zip(links.bodies, change, strict=True)
            ),
            start=np.zeros(len(recording.time)),
        )[:, None]
        for joint in recording.joints
    }
    values = dict(zip(links.names, links.declared + change, strict=True))
    candidate = Candidate(effect=LINKS, joint=recording.joints[0])
    changes = dict(zip(links.bodies, change, strict=True))
    given = Given(torque=torque, candidate=candidate, links=values, changes=changes)
    return replace(model, given=given)
