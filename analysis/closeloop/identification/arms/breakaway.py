"""Friction that a joint shows at rest and hardly in motion: it breaks away late, and then slides.

A joint passes the speeds at which Stribeck's excess is lost in milliseconds, and the low-pass that
its noise asks for takes most of what is left of it. At rest the same friction holds whatever the
motor happens to apply, up to its breakaway level (Armstrong-Helouvry, Dupont and Canudas de Wit
1994, section 2): more than the friction in motion where there is an excess, never more elsewhere.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from analysis.closeloop.identification.balance.accuracy import raw_errors
from analysis.closeloop.identification.balance.luck import MIN_TORQUE, MIN_Z
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Given,
    Model,
    Term,
    evaluate,
    one_joint,
    prediction,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.growing.steps import Grown
from analysis.closeloop.identification.nameable import beyond_physics, lowest
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import REST, runs
from analysis.closeloop.session.signals import rms
from sim.effects.catalogue import BY_NAME

STRIBECK, COULOMB = BY_NAME["stribeck_friction"], BY_NAME["coulomb_friction"]
#: Speeds at which the excess may be lost, over the top speed. No motion shows lower ones.
SPEEDS = np.geomspace(0.004, 0.4, 21)
#: What is held for so long is no reversal, s.
HELD = 2.0 * REST
NOTE = (
    "stribeck_friction of {}: at rest it holds {:.3g} {} to either side and slides with {:.3g}; "
    "the excess is known from the rests, and is at least the difference"
)


@dataclass(frozen=True)
class Held:
    """What a joint holds at rest, to the side where it is less, and slides with; Nm or N."""

    level: float
    sliding: float
    #: Root mean square of what the model leaves of the joint in motion.
    error: float

    @property
    def z(self) -> float:
        """What is held beyond the sliding friction, in errors."""
        return (self.level - self.sliding) / self.error


def with_breakaway(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Put Stribeck friction in the place of Coulomb's where rests show an excess.

    Args:
        grown: the model with its effects.
        rows: the samples to fit.

    Returns:
        The model, and a sentence for each joint of which it was changed.
    """
    notes = []
    for joint in rows.joints:
        found = _held(grown, rows, joint)
        if found is None:
            continue
        changed = _with_excess(grown, rows, joint, found)
        if changed is not None:
            grown = changed
            unit = "Nm" if rows.recording.is_hinge(joint) else "N"
            name = rows.recording.name(joint)
            notes.append(NOTE.format(name, found.level, unit, found.sliding))
    return grown, tuple(notes)


def held_levels(torque: np.ndarray, width: int) -> tuple[float, float]:
    """Return the most that one rest holds to the positive and to the negative side.

    Args:
        torque: of the motor beyond what else the joint carries, Nm or N, (n,).
        width: samples over which it is held; a shorter rest holds nothing.
    """
    torque = torque[np.isfinite(torque)]
    if len(torque) < width:
        return -np.inf, -np.inf
    means = sliding_window_view(torque, width).mean(axis=1)
    return float(means.max()), float(-means.min())


def _held(grown: Grown, rows: Rows, joint: int) -> Held | None:
    """Return what a joint with plain friction holds beyond it at rest; None if that may be none."""
    model, recording = grown.model, rows.recording
    coefficients = np.array(grown.score.coefficients)
    sliding = float(recording.device.friction[joint])
    for term, own in model.split(coefficients):
        if term.joint != joint or term.effect is None or not term.rubs or term.effect.winds:
            continue
        if term.effect is not COULOMB:
            return None
        sliding += float(own[0])
        own[:] = 0.0
    if sliding <= 0.0:
        return None
    # What friction the file declares has no direction at rest.
    expected = prediction(model, coefficients)
    expected[:, joint] -= (recording.inverse - recording.rigid)[:, joint]
    # The fit's low-pass would overshoot where a torque changes its side.
    errors = raw_errors(recording.of_joint(joint), expected, recording.fit_trials)
    width = max(2, round(HELD * recording.sampling.recorded))
    sides = [
        held_levels(error.residual[slice(*np.searchsorted(error.time, rest))], width)
        for error in errors
        for rest in _rests(recording, joint, error.trial)
    ]
    if not sides:
        return None
    # To either side: what a wrong offset or gravity adds to one it takes from the other.
    level = float(np.min(np.max(sides, axis=0)))
    held = Held(level, sliding, rows.left_by_joint(grown.score.losses)[joint])
    least = MIN_TORQUE * rms(recording.effort[rows.samples[joint], joint])
    return held if held.z > MIN_Z and level - sliding > least else None


def _rests(recording: Recording, joint: int, trial: int) -> Iterator[tuple[float, float]]:
    """Yield when a joint rests in a trial and nothing disturbs it, from and to, s."""
    for piece in recording.pieces_of(trial):
        resting = recording.resting(joint, piece) & recording.usable[piece]
        if recording.disturbed is not None:
            resting &= ~recording.disturbed[piece, joint]
        resting[: recording.edge] = False
        resting[len(resting) - recording.edge :] = False
        clock = recording.time[piece]
        for rest in runs(resting):
            yield clock[rest.start], clock[rest.stop - 1]


def _with_excess(grown: Grown, rows: Rows, joint: int, held: Held) -> Grown | None:
    """Return the model with the excess that is held, if the motion allows it.

    It may predict worse by one standard error, as the simpler of two models is chosen (Breiman,
    Friedman, Olshen and Stone 1984, section 3.4.3): here the other one does not hold the joint.
    """
    own = rows.of_joint(joint)
    coulomb, stribeck = (Candidate(effect=effect, joint=joint) for effect in (COULOMB, STRIBECK))
    plain = one_joint(grown.model, grown.score.coefficients, joint)
    before = evaluate(plain, own)
    alone = _with_speed(plain, own, joint, held)
    if alone is None:
        return None
    after = evaluate(alone, own)
    gain, error = compare(before.losses, after.losses)
    if gain < -error or beyond_physics(alone, after, stribeck):
        return None
    rest = grown.model.without(coulomb)
    model = rest.with_term(alone.terms[-1])
    score, bare = evaluate(model, rows), evaluate(rest, rows)
    here = rows.joint_of_block == joint
    gain, error = compare(bare.losses[here], score.losses[here])
    taken = Option(
        candidate=stribeck,
        model=model,
        score=score,
        gain=max(gain, 0.0),
        z=max(gain / error, held.z),
        replaced=frozenset({coulomb.key} & {c.key for c in grown.model.effects}),
    )
    before_it = float(bare.losses[here].sum())
    step = Step(taken=taken, equals=(), options=(), before=before_it)
    others = tuple(other for other in grown.steps if other.key != coulomb.key)
    return Grown(model, score, (*others, step))


def _with_speed(plain: Model, rows: Rows, joint: int, held: Held) -> Model | None:
    """Return the model with Stribeck friction that loses its excess at the speed that fits best.

    That is chosen with the excess as it is held: the less a motion shows of it, the larger an
    excess would fit that is lost at a lower speed.
    """
    recorded, excess = unfitted(plain.recording, joint), held.level - held.sliding
    turning = [t.theta["smooth"] for t in plain.terms if t.rubs and "smooth" in t.theta]
    candidate = Candidate(effect=STRIBECK, joint=joint)
    rest = plain.without(Candidate(effect=COULOMB, joint=joint))
    assert rest.given is not None
    constant, _ = lowest(rest, candidate)
    found: list[tuple[float, Model]] = []
    for speed in SPEEDS:
        theta = {"smooth": min([*turning, 0.4 * speed]), "speed": float(speed)}
        columns = STRIBECK.columns(recorded, theta)
        given = rest.given.torque[joint] + excess * columns[joint][:, [1]]
        term = Term(
            effect=STRIBECK,
            joint=joint,
            columns=columns,
            lower=(constant, excess),
            theta=theta,
            candidate=candidate,
        )
        model = with_independent(rest, term, rows)
        own = model.terms[-1]
        if model is rest or 1 not in own.kept:
            continue
        sliding = replace(rest, given=Given(torque={joint: given}))
        if 0 in own.kept:
            sliding = sliding.with_term(replace(own, kept=(0,)))
        found.append((evaluate(sliding, rows).sse, model))
    return min(found, key=lambda pair: pair[0], default=(0.0, None))[1]
