"""A model of the balance: the declared unknowns and the effects added so far, with their fit."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np

from analysis.closeloop.identification.balance.least_squares import keep_independent
from analysis.closeloop.identification.balance.regression import Rows, Score, Variant, score
from analysis.closeloop.identification.balance.terms import (
    Candidate,
    Channel,
    Given,
    Term,
    kept_columns,
)
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import lagged
from sim.effects.effect import Columns, Effect
from sim.effects.laws.elastic import Viscoelastic
from sim.effects.laws.inertia import PLACE, PlacedPayload, load_parameters
from sim.effects.laws.loose_link import DAMPED, SeriesElasticity
from sim.effects.motion import Estimate, RecordedJoint, Spring

#: No joint has another.
NOWHERE: Mapping[int, float] = {}


@dataclass(frozen=True)
class Model:
    """Terms and channels of a recording; fitted by `evaluate`."""

    recording: Recording
    terms: tuple[Term, ...] = ()
    channels: tuple[Channel, ...] = ()
    given: Given | None = None

    @property
    def effects(self) -> tuple[Candidate, ...]:
        found = [term.candidate for term in self.terms if term.candidate is not None]
        if self.given is not None and self.given.candidate is not None:
            found.append(self.given.candidate)
        return (*found, *(channel.candidate for channel in self.channels))

    @property
    def declared(self) -> set[tuple[str, int]]:
        """Effects that the session declares, each with its joint."""
        numbers = {name: number for number, name in enumerate(self.recording.device.joints)}
        declared = self.recording.session.declared
        return {(d.effect, numbers[d.joint]) for d in declared if d.joint in numbers}

    def transformed(self, columns: Columns) -> Columns:
        """Pass columns through every channel, known or found."""
        out = {}
        for joint, column in columns.items():
            for channel in self.channels:
                if channel.candidate.joint == joint:
                    effect = channel.candidate.effect
                    column = effect.through(self.recording, column, channel.theta)
            out[joint] = _known_filter(self.recording, column)
        return out

    def known(self) -> Columns:
        """Return the torque that needs no fit, per analysed joint, (n, 1)."""
        torque = {j: self.recording.inverse[:, [j]] for j in self.recording.joints}
        if self.given is not None:
            torque = {j: own + self.given.torque.get(j, 0.0) for j, own in torque.items()}
        return self.transformed(torque)

    @property
    def channel_key(self) -> tuple[tuple[str, int, tuple[tuple[str, float], ...]], ...]:
        """What tells one set of channels from another."""
        return tuple((*c.candidate.key, tuple(c.theta.items())) for c in self.channels)

    def target(self, rows: Rows) -> np.ndarray:
        def make() -> tuple[Given | None, np.ndarray]:
            return self.given, rows.stack_effort() - rows.stack(self.known(), 1)[:, 0]

        return np.asarray(rows.once(("target", id(self.given), self.channel_key), make)[1])

    def base(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Return all terms' kept columns stacked over rows, and their bounds."""
        parts, bounds = [np.empty((len(rows.weight), 0))], []
        for term in self.terms:
            parts.append(self._stacked(term, rows))
            bounds += [term.bound(i) for i in term.kept]
        return np.concatenate(parts, axis=1), np.array(bounds)

    def _stacked(self, term: Term, rows: Rows) -> np.ndarray:
        def make() -> tuple[Term, np.ndarray]:
            # The term is kept beside its columns, so that no other can have its identity.
            return term, rows.stack(self.transformed(kept_columns(term)), len(term.kept))

        return np.asarray(rows.once(("term", id(term), self.channel_key), make)[1])

    def with_term(self, term: Term) -> "Model":
        return replace(self, terms=(*self.terms, term))

    def keeping(self, wanted: Callable[[Candidate], bool]) -> "Model":
        """Return the model with what is declared and the added effects that are wanted."""
        return replace(
            self,
            terms=tuple(t for t in self.terms if t.candidate is None or wanted(t.candidate)),
            channels=tuple(c for c in self.channels if wanted(c.candidate)),
            given=self._given_of(wanted),
        )

    def _given_of(self, wanted: Callable[[Candidate], bool]) -> Given | None:
        candidate = None if self.given is None else self.given.candidate
        return self.given if candidate is None or wanted(candidate) else None

    def without(self, candidate: Candidate) -> "Model":
        """Return the model without an added effect."""
        return self.keeping(lambda other: other != candidate)

    def split(self, coefficients: np.ndarray) -> Iterator[tuple[Term, np.ndarray]]:
        """Return every term with its own of the model's coefficients, (..., its kept columns)."""
        start = 0
        for term in self.terms:
            stop = start + len(term.kept)
            yield term, coefficients[..., start:stop]
            start = stop


def one_joint(model: Model, coefficients: np.ndarray, joint: int) -> Model:
    """Return the part of a fitted model that concerns one joint.

    Terms that other joints share are given as they were fitted.
    """
    recording, split = model.recording, model.split(coefficients)
    shared = [(term, own) for term, own in split if set(term.columns) != {joint}]
    given = np.zeros((len(recording.time), 1))
    if model.given is not None:
        given = given + model.given.torque.get(joint, 0.0)
    for term, own in shared:
        if joint in term.columns:
            given = given + kept_columns(term)[joint] @ own[:, None]
    return Model(
        recording.of_joint(joint),
        terms=tuple(term for term in model.terms if set(term.columns) == {joint}),
        channels=tuple(c for c in model.channels if c.candidate.joint == joint),
        given=Given(torque={joint: given}, changes=link_changes(model, shared)),
    )


def with_independent(model: Model, term: Term, rows: Rows, least: float | None = None) -> Model:
    """Add the columns of `term` of which the model leaves a share, by default its effect's own."""
    base, _ = model.base(rows)
    stacked = rows.stack(model.transformed(term.columns), term.width)
    own = (term.effect or Effect).least_own if least is None else least
    _, kept = keep_independent(base, stacked, own)
    return model.with_term(replace(term, kept=kept)) if kept else model


def unfitted(recording: Recording, joint: int) -> RecordedJoint:
    """Return a joint as it is known before any fit."""
    count = recording.position.shape[1]
    estimate = Estimate(
        stiffness=np.zeros(count),
        damping=np.zeros(count),
        prediction=recording.inverse,
        carried=recording.rigid - of_motors(recording),
        residual=recording.effort - recording.inverse,
        shared=np.zeros_like(recording.position),
    )
    return RecordedJoint(recording, joint, estimate)


def of_motors(recording: Recording) -> np.ndarray:
    """Return what declared motors take themselves, by inertia and damping, Nm or N, (n, joints)."""
    joints = range(recording.position.shape[1])
    inertia = np.array([recording.motor_inertia(joint) for joint in joints])
    damping = np.array([recording.motor_damping(joint) for joint in joints])
    return np.asarray(inertia * recording.acceleration + damping * recording.velocity)


def evaluate(model: Model, rows: Rows, *, fold_rows: Sequence[np.ndarray] | None = None) -> Score:
    """Fit the model to the rows and score it on left-out folds: the groups, or `fold_rows`."""
    base, lower = model.base(rows)
    alone = Variant(theta={}, columns=np.empty((len(base), 0)), kept=())
    return score(rows, model.target(rows), base, lower, [alone], (0.0,), fold_rows=fold_rows)


def prediction(model: Model, coefficients: np.ndarray) -> np.ndarray:
    """Return the effort that the fitted model expects, unfiltered, (n, joints); NaN elsewhere."""
    recording = model.recording
    out = np.full_like(recording.position, np.nan)
    for joint, known in model.known().items():
        out[:, joint] = known[:, 0]
    for term, own in model.split(coefficients):
        for joint, columns in model.transformed(kept_columns(term)).items():
            out[:, joint] += columns @ own
    return out


def estimate_of(model: Model, coefficients: np.ndarray) -> Estimate:
    """Return what the fitted model says to effects that scale with it."""
    recording = model.recording
    count = recording.position.shape[1]
    stiffness, damping = np.zeros(count), np.zeros(count)
    for joint, values in fitted_impedances(model, coefficients).items():
        stiffness[joint], damping[joint] = values["stiffness"], values["damping"]
    torque = prediction(model, coefficients)
    smooth = recording.filtered(np.nan_to_num(torque))
    residual = np.where(np.isnan(torque), np.nan, recording.effort - smooth)
    return Estimate(
        stiffness=stiffness,
        damping=damping,
        prediction=smooth,
        carried=_carried(model, coefficients),
        residual=residual,
        shared=shared_torque(model, model.split(coefficients)),
        changes=link_changes(model, model.split(coefficients)),
        springs=dict(_springs(model, coefficients)),
        elastic=elastic_torques(model, model.split(coefficients)),
    )


def elastic_torques(
    model: Model, fitted: Iterable[tuple[Term, np.ndarray]]
) -> dict[int, Callable[[np.ndarray], np.ndarray]]:
    """Return the torque of what is elastic of limbs beside their stiffness, by joint.

    Each from how far a limb is behind its device, (n,), Nm or N, (n,).

    Args:
        model: fitted.
        fitted: its terms with their coefficients.
    """
    found: dict[int, list[tuple[Term, np.ndarray]]] = {}
    for term, own in fitted:
        if term.effect is not None and term.effect.elastic:
            found.setdefault(term.joint, []).append((term, np.array(own)))

    def of(joint: int) -> Callable[[np.ndarray], np.ndarray]:
        recorded = unfitted(model.recording, joint)

        def torque(behind: np.ndarray) -> np.ndarray:
            there = replace(recorded, behind=behind)
            parts = [
                term.effect.columns(there, term.theta)[joint][:, list(term.kept)] @ own
                for term, own in found[joint]
                if term.effect is not None
            ]
            return np.asarray(np.sum(parts, axis=0))

        return torque

    return {joint: of(joint) for joint in found}


def estimate_beside(model: Model, coefficients: np.ndarray, own: Term | None) -> Estimate:
    """Return the estimate of the fitted model without the torque of one term, if that is given."""
    left = np.array(coefficients)
    for term, part in model.split(left):
        same = own is not None and term.candidate is not None and term.candidate == own.candidate
        if same or term is own:
            part[:] = 0.0
    return estimate_of(model, left)


def _springs(model: Model, coefficients: np.ndarray) -> Iterator[tuple[int, Spring]]:
    """Yield the springs that were found of a fitted model, each with its joint."""
    for term, own in model.split(coefficients):
        if term.candidate is not None and isinstance(term.effect, SeriesElasticity):
            torque = np.zeros_like(model.recording.position)
            for joint, columns in kept_columns(term).items():
                torque[:, joint] = columns @ own
            yield term.joint, Spring(term.theta, torque)


def _carried(model: Model, coefficients: np.ndarray) -> np.ndarray:
    """Return what the fitted model's motors carry, without friction, Nm or N, (n, joints).

    At the joint: no effort channel has passed it on, late or low-passed.
    """
    recording = model.recording
    torque = recording.rigid - of_motors(recording)
    torque = torque + shared_torque(model, model.split(coefficients))
    for term, found in model.split(coefficients):
        scales = term.effect is not None and term.effect.scales_effort
        if len(term.columns) == 1 and not (term.rubs or scales):
            for joint, columns in kept_columns(term).items():
                torque[:, joint] += columns @ found
    return np.asarray(torque)


def shared_torque(model: Model, fitted: Iterable[tuple[Term, np.ndarray]]) -> np.ndarray:
    """Return what links, loads and other joints take of each beyond the declared, (n, joints).

    Of a model with what is given, and its terms with their coefficients.
    """
    torque = np.zeros_like(model.recording.position)
    for joint, own in (model.given.torque if model.given is not None else {}).items():
        torque[:, joint] += own[:, 0]
    for term, found in fitted:
        if len(term.columns) > 1:
            for joint, columns in kept_columns(term).items():
                torque[:, joint] += columns @ found
    return torque


def link_changes(model: Model, fitted: Iterable[tuple[Term, np.ndarray]]) -> dict[int, np.ndarray]:
    """Return by how much links and loads of a model differ from the declared.

    Args:
        model: with what is given.
        fitted: its terms with their coefficients.

    Returns:
        Inertial parameters by the number of the body, (10,) or (n, 10).
    """
    recording = model.recording
    found = dict(model.given.changes) if model.given is not None else {}
    for term, own in fitted:
        if not isinstance(term.effect, PlacedPayload):
            continue
        turn = load_parameters(np.array([term.theta[name] for name in PLACE]))
        body, change = recording.body(term.joint), turn[:, list(term.kept)] @ own
        if term.load is not None:
            body = recording.device.model.body(term.load.body).id
            change = change * hung_in(recording, term.load)
        found[body] = found.get(body, 0.0) + change
    return found


def hung_in(recording: Recording, load: HungLoad) -> np.ndarray:
    """Return where the trials name a load, (n, 1)."""
    named = [trial.payload == load for trial in recording.session.trials]
    return np.asarray(np.array(named)[recording.trial][:, None])


def impedances(
    model: Model, coefficients: np.ndarray, behind: Mapping[int, float] = NOWHERE
) -> dict[int, dict[str, float]]:
    """Return stiffness, damping and neutral angle of every joint with a declared impedance.

    In the restoring sense: the joint feels -K (q - q0) - D q'. Of the damping what a spring has
    before it is the motor's friction, and no limb's.

    Args:
        model: with the impedances.
        coefficients: of the model.
        behind: another share of the damping that is behind a spring, by its joint.
    """
    found = fitted_impedances(model, coefficients)
    for term in model.terms:
        if term.joint in found and DAMPED in term.theta:
            found[term.joint]["damping"] *= behind.get(term.joint, term.theta[DAMPED])
    return found


def fitted_impedances(model: Model, coefficients: np.ndarray) -> dict[int, dict[str, float]]:
    """Return the same of the balance: its damping holds the motor's friction, too."""
    return {
        term.joint: term.effect.impedance(
            dict(zip(term.kept, own, strict=True)), gain(model, coefficients, term.joint)
        )
        for term, own in model.split(coefficients)
        if isinstance(term.effect, Viscoelastic)
    }


def gain(model: Model, coefficients: np.ndarray, joint: int) -> float:
    """Return the torque at a joint over its effort: 1 unless an effect that scales it was found."""
    return prod(
        term.effect.gain(own)
        for term, own in model.split(coefficients)
        if term.effect is not None and term.joint == joint
    )


def _known_filter(recording: Recording, column: np.ndarray) -> np.ndarray:
    """Apply a trial's declared low-pass of the effort channel."""
    trials: Mapping[int, float] = {
        number: trial.effort_filter_hz
        for number, trial in enumerate(recording.session.trials)
        if trial.effort_filter_hz is not None
    }
    if not trials:
        return column
    out = np.array(column)
    for piece in recording.slices:
        cutoff = trials.get(recording.trial_of(piece))
        if cutoff is not None:
            out[piece] = lagged(column[piece], 1.0 / (2 * np.pi * cutoff), recording.rate)
    return out
