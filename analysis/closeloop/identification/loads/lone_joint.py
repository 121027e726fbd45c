"""What a trial of a robot's one joint carries though nobody said so.

One joint tells a load from friction and an offset that change if what its trial needs more has the
shape of gravity over the angle and that of inertia, both of a mass within the arm's reach. A point
mass takes

    g (p_1 cos q + p_2 sin q) + J q'',    mass = |p|^2 / J, distance = J / |p|,

with gravity g across the axis, first moments p (kg m) and inertia J (kg m2). From a gain that is
another in that trial only several joints tell it: then both are said.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from analysis.closeloop.identification.arms.agreed import CHANCE, MOST, sure
from analysis.closeloop.identification.arms.links import last_links, links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import weighed_by
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit
from analysis.closeloop.identification.balance.declared import declared_model, naming
from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS
from analysis.closeloop.identification.balance.regression import compare, select_rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.inertia import MOST_LOAD, UPRIGHT

GRAVITY, INERTIA, FRICTION = "gravity", "inertia", "friction"
LOAD = (GRAVITY, INERTIA)


def supposing_lone_loads(recording: Recording) -> Recording:
    """Return the recording with the loads named that trials of a robot's one joint seem to carry.

    Only of a hinge that is not upright, and only beside a trial that carries less.
    """
    if len(recording.device.joints) > 1 or recording.limbs:
        return recording
    (joint,) = recording.joints
    rows = select_rows(recording, recording.fit_trials)
    seconds = {n: len(np.unique(rows.block[rows.trial == n])) for n in recording.fit_trials}
    free = [n for n in seconds if recording.session.trials[n].payload is None]
    asked = [number for number in free if seconds[number] >= LEAST_BLOCKS]
    if len(asked) < 2:
        return recording
    across = _across(recording, joint)
    bodies = last_links(recording)
    if not recording.is_hinge(joint) or not across or not bodies:
        return recording
    body = min(bodies.items())[1]
    found: dict[int, HungLoad] = {}
    for numbers, share in _carriers(recording, body, asked, across):
        name = "of trial " + ", ".join(str(number + 1) for number in numbers)
        found |= dict.fromkeys(numbers, HungLoad(name=name, body=body, supposed=share))
    return naming(recording, found)


def _carriers(
    recording: Recording, body: str, asked: Sequence[int], across: float
) -> list[tuple[list[int], float]]:
    """Return trials that carry one load, and the part of what is left of them that it takes.

    Args:
        recording: of a robot with one joint.
        body: that it would hang on.
        asked: numbers of the fitted trials that name none.
        across: gravity across the joint's axis, m/s2.
    """
    fits = _Fits(recording, body, asked)
    # Beside free links a load is what a trial carries more than the one that carries least.
    first, *others = asked
    beside = fits.beside(dict.fromkeys(others, LOAD))
    more = {first: 0.0, **{n: float(fits.own(beside, INERTIA, n)[0]) for n in others}}
    taken = [number for number in asked if number != min(more, key=more.__getitem__)]
    while taken:
        shares = {number: fits.share(number, taken, across) for number in taken}
        least = min(taken, key=shares.__getitem__)
        if shares[least]:
            break
        taken.remove(least)
    if len(taken) > 1 and fits.are_one(taken):
        return [(taken, min(shares.values()))]
    return [([number], shares[number]) for number in taken]


def _across(recording: Recording, joint: int) -> float:
    """Return gravity across a joint's axis, m/s2; 0 if the axis stands upright."""
    axis, gravity = recording.chain.axis[joint, :, 0], recording.gravity
    across = float(np.linalg.norm(gravity - axis * (axis @ gravity)))
    return across if across > UPRIGHT * float(np.linalg.norm(gravity)) else 0.0


class _Fits:
    """Fits with what a trial may have of its own, beside plain friction and free links."""

    def __init__(self, recording: Recording, body: str, asked: Sequence[int]) -> None:
        (self.joint,) = recording.joints
        # Every trial that may have something alone is left out by halves.
        loads = {n: HungLoad(name=f"of trial {n + 1}", body=body) for n in asked}
        named = naming(recording, loads)
        rows = select_rows(named, named.fit_trials)
        bare = declared_model(recording, select_rows(recording, recording.fit_trials))
        model = with_ordinary(type(bare)(named, bare.terms), rows)
        self.rows, self.links = weighed_by(model, rows), links_of(named)
        angle, velocity = named.position[:, self.joint], named.velocity[:, self.joint]
        direction = named.built_in_direction[:, self.joint]
        self.columns = {
            GRAVITY: np.column_stack([np.cos(angle), np.sin(angle)]),
            INERTIA: named.acceleration[:, [self.joint]],
            FRICTION: np.column_stack([np.ones(len(angle)), direction, velocity]),
        }
        # The joint's own links are free without bounds: what these hold would be the load's.
        model = model.keeping(lambda candidate: candidate.effect.name != "added_inertia")
        for kind in LOAD:
            model = model.with_term(self._term(kind, named.trial >= 0))
        self.common = len(model.terms)
        self.places: dict[tuple[str, int], int] = {}
        for number in asked:
            for kind in self.columns:
                self.places[kind, number] = len(model.terms)
                model = model.with_term(self._term(kind, np.isin(named.trial, [number])))
        self.model = model
        self.fit = WholeFit(model, self.rows, self.links)

    def _term(self, kind: str, where: np.ndarray) -> Term:
        columns = self.columns[kind] * where[:, None]
        kept = tuple(range(columns.shape[1]))
        return Term(joint=self.joint, columns={self.joint: columns}, kept=kept)

    def beside(self, own: dict[int, Sequence[str]]) -> Fitted:
        """Fit what trials have of their own, beside what all have."""
        places = [self.places[kind, number] for number, kinds in own.items() for kind in kinds]
        return self.fit.alone([*range(self.common), *places])

    def own(self, fitted: Fitted, kind: str, number: int) -> np.ndarray:
        """Return the coefficients of what a trial has of its own."""
        return np.asarray(fitted.coefficients[self.fit.owner == self.places[kind, number]])

    def share(self, number: int, taken: Sequence[int], across: float) -> float:
        """Return the part of what is left of a trial that a load takes; 0 unless it is one."""
        loads: dict[int, Sequence[str]] = dict.fromkeys(taken, LOAD)

        def having(*kinds: str) -> Fitted:
            return self.beside({**loads, number: kinds})

        hung, every = having(*LOAD), having(*LOAD, FRICTION)
        if not self._can_be(every, number, across) or not self._can_be(hung, number, across):
            return 0.0
        # Beside friction of its own both shapes are missed; inertia only has to bear gravity out.
        weightless, inert = having(FRICTION, INERTIA), having(FRICTION, GRAVITY)
        lost, error = compare(self._losses(inert, number), self._losses(every, number))
        if not self._sure(weightless, every, number) or lost < float(norm.isf(CHANCE)) * error:
            return 0.0
        changed = having(FRICTION)
        left, still = (self._losses(fitted, number) for fitted in (changed, hung))
        if still.sum() > (1.0 - MOST) * left.sum() or not self._sure(changed, hung, number):
            return 0.0
        left, still = (self._losses(fitted, number) for fitted in (having(), hung))
        return 1.0 - float(still.sum() / left.sum())

    def _can_be(self, fitted: Fitted, number: int, across: float) -> bool:
        """Whether a trial's moments and inertia are those of a mass that the arm may carry."""
        recording = self.model.recording
        (inertia,), moments = (self.own(fitted, kind, number) for kind in (INERTIA, GRAVITY))
        moment = float(np.linalg.norm(moments)) / across
        if inertia <= 0.0 or moment <= 0.0:
            return False
        mass, distance = moment**2 / inertia, inertia / moment
        return bool(mass <= MOST_LOAD * recording.mass and distance <= recording.reach(self.joint))

    def _of(self, number: int) -> np.ndarray:
        """Return which blocks are of a trial, (blocks,)."""
        return np.unique(self.rows.block[self.rows.trial == number])

    def _losses(self, fitted: Fitted, number: int) -> np.ndarray:
        return np.asarray(fitted.losses[self._of(number)])

    def _sure(self, worse: Fitted, better: Fitted, number: int) -> bool:
        own = self._of(number)
        return sure(worse.losses[own], better.losses[own], self.rows.fold_of_block[own])

    def are_one(self, taken: Sequence[int]) -> bool:
        """Whether one load in the place of several predicts as well."""
        model, where = self.model, np.isin(self.model.recording.trial, taken)
        for kind in LOAD:
            model = model.with_term(self._term(kind, where))
        one = WholeFit(model, self.rows, self.links)
        count = len(self.model.terms)
        both = one.alone([*range(self.common), count, count + 1])
        lost, error = compare(both.losses, self.beside(dict.fromkeys(taken, LOAD)).losses)
        return lost <= error
