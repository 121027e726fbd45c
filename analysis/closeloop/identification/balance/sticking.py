"""Friction where a joint sticks: it has any value there, and the fit's low-pass spreads it.

Friction that is fitted turns with the velocity. Where a controller takes a while to turn a joint
around, its friction goes from one side to the other meanwhile, in a way that no motion shows. Of an
arm with friction of a hundred times its noise that is nearly all that is left, and hides the rest.
Where less is left the rows stay: they show how friction turns, and without them a UR10e's wrist was
predicted worse than by least squares.
"""

from collections.abc import Iterator

import numpy as np
from scipy.signal import oaconvolve

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Term, kept_columns
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import lowpass, rms
from sim.effects.motion import PRESLIDING_SHARE, travel, wound

#: A standard deviation over the median of sizes.
SPREAD = 1.4826
#: Least time that a joint moves by itself in each direction, s, before it shows its friction.
MOVED = 0.5
#: Periods of the fit's cutoff over which its low-pass rings.
RINGS = 4.0
#: How many times as much is left in rows that say little as in the others, in root mean square.
LEFT = 3.0
#: Least share of a joint's rows that are left, those that say most.
LEAST_KEPT = 0.5


def sliding(model: Model, rows: Rows, residual: np.ndarray) -> Rows:
    """Return the rows without those in which friction that nobody knows is nearly all that is left.

    It may be more than noise there, and what is left shows that it is.

    Args:
        model: what is known of the joints.
        rows: the samples to fit.
        residual: what ordinary effects leave of every row, Nm or N, low-passed, (r,).
    """
    known = known_friction(model, rows, residual)
    return rows.where(_telling(rows, residual, known))


def sliding_anyway(model: Model, rows: Rows) -> Rows:
    """Return the same rows where a model is all that is known, fitted to those that tell friction.

    Fitted to all, what sticks hides how little is left of the others. (A cuff's spring beside
    friction: an opponent's.)
    """
    known = known_friction(model, rows, left_of(model, rows, rows))
    return rows.where(_telling(rows, left_of(model, rows, rows.where(known)), known))


def left_of(model: Model, rows: Rows, fitted: Rows) -> np.ndarray:
    """Return what a model leaves of every row, fitted to some of them, Nm or N, (r,)."""
    coefficients = evaluate(model, fitted).coefficients
    return np.asarray((model.target(rows) - model.base(rows)[0] @ coefficients) / rows.weight)


def _telling(rows: Rows, residual: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return every row of joints of which the others leave little more, and else the known ones."""
    kept = np.ones(len(rows.weight), dtype=bool)
    for joint in rows.joints:
        part = rows.parts[joint]
        left, own = residual[part], known[part]
        if own.all() or rms(left[~own]) <= LEFT * rms(left[own]):
            continue
        if _ways(rows, joint, own) == _ways(rows, joint, np.ones(len(own), dtype=bool)):
            kept[part] = own
    return kept


def _ways(rows: Rows, joint: int, kept: np.ndarray) -> list[bool]:
    """Return whether a joint moves both ways, long enough, in what is fitted of each fold.

    Where it goes one way but for a turn, friction is an offset without that turn. (An opponent's
    UR10: a wrist that rubs was predicted four times as badly as by least squares.)

    Args:
        rows: the samples.
        joint: its number.
        kept: which of its samples are kept, (s,).
    """
    samples, fold = rows.samples[joint], rows.fold_of_block[rows.block[rows.parts[joint]]]
    velocity, speed = rows.recording.velocity[samples, joint], rows.recording.rest_speed[joint]
    least = MOVED * rows.recording.rate / samples_step(samples)

    def moves(one: int, sign: float) -> bool:
        return int(np.sum(kept & (fold != one) & (sign * velocity > speed))) >= least

    return [moves(one, 1.0) and moves(one, -1.0) for one in np.unique(fold)]


def known_friction(model: Model, rows: Rows, residual: np.ndarray) -> np.ndarray:
    """Return in which rows what friction may have is less than noise, or in the better half.

    Arguments are those of `sliding`.
    """
    known = np.ones(len(rows.weight), dtype=bool)
    for joint in rows.joints:
        part = rows.parts[joint]
        own = unknown_friction(model, rows, joint)[rows.samples[joint]]
        noise = SPREAD * float(np.median(np.abs(residual[part])))
        known[part] = own <= max(noise, float(np.quantile(own, LEAST_KEPT)))
    return known


def unknown_friction(model: Model, rows: Rows, joint: int) -> np.ndarray:
    """Return how much of a joint's friction no motion shows, Nm or N, low-passed, (n,).

    Its own where it turns, and that of motors which turn with it and another joint where they do;
    when its effort has it: a delay moves it. (Four of a stranger's sticks were told as pushes.)
    """
    found = friction_of(model, rows, joint) * sticking(rows.recording, joint)
    for friction, motor in coupled_motors(model, rows, joint):
        found += friction * motor_sticking(rows.recording, motor)
    return np.abs(model.transformed({joint: found[:, None]})[joint][:, 0])


def sticking(recording: Recording, joint: int) -> np.ndarray:
    """Return what is left at most, low-passed, of a torque of 1 where a joint turns, (n,).

    As long as it sticks, or has not gone presliding's way since, its friction has any value; the
    low-pass spreads that, and rings.
    """
    position, velocity = recording.position[:, joint], recording.velocity[:, joint]
    return _sticking(recording, position, velocity, recording.rest_speed[joint])


def motor_sticking(recording: Recording, motor: Term) -> np.ndarray:
    """Return the same where a motor turns that turns with two joints, (n,)."""
    joint, other = motor.joint, int(motor.theta["other_dof"])
    position, velocity = (
        signal[:, joint] + motor.theta["sense"] * signal[:, other]
        for signal in (recording.position, recording.velocity)
    )
    rest_speed = recording.rest_speed[joint] + recording.rest_speed[other]
    return _sticking(recording, position, velocity, rest_speed)


def _sticking(
    recording: Recording, position: np.ndarray, velocity: np.ndarray, rest_speed: float
) -> np.ndarray:
    rate, cutoff = recording.rate, recording.sampling.fit_cutoff
    one = np.zeros(2 * int(RINGS * rate / cutoff) + 1)
    one[len(one) // 2] = 1.0
    response = np.abs(lowpass(one, cutoff, rate))
    gives_way = 0.5 * PRESLIDING_SHARE * travel(position)[1]
    winding = np.abs(wound(position, recording.slices, gives_way, 0.0)) < 1.0
    unknown = (recording.turns(velocity, rest_speed) | winding).astype(float)
    return np.concatenate(
        [oaconvolve(unknown[piece], response, mode="same") for piece in recording.slices]
    )


def coupled_motors(model: Model, rows: Rows, joint: int) -> Iterator[tuple[float, Term]]:
    """Yield what motors that turn with a joint and another rub, Nm or N, and their terms."""
    for term, own in model.split(evaluate(model, rows).coefficients):
        is_motor = term.effect is not None and term.effect.name == "coupled_motor"
        if is_motor and term.joint == joint and 0 in term.kept:
            yield float(own[term.kept.index(0)]), term


def friction_of(model: Model, rows: Rows, joint: int) -> float:
    """Return half of the step that a joint's torque makes where it turns, Nm or N.

    At least what the model says of its friction. Of a joint that hardly moves by itself nothing
    more: what pushes a held joint to and fro is no friction.
    """
    recording = rows.recording
    samples = rows.samples[joint]
    coefficients = evaluate(model, rows).coefficients
    rigid = recording.filtered(recording.rigid[:, [joint]])[samples, 0]
    rubbing, fitted = recording.effort[samples, joint] - rigid, np.zeros(len(samples))
    for term, own in model.split(coefficients):
        if joint in term.columns:
            torque = recording.filtered(kept_columns(term)[joint])[samples] @ own
            rubbing, fitted = (
                (rubbing, fitted + torque) if term.rubs else (rubbing - torque, fitted)
            )
    known = float(np.median(np.abs(fitted)))
    slow = np.abs(recording.velocity[samples, joint]) < 0.25 * recording.top_speed[joint]
    slow &= driven(recording, joint, samples)
    sides = [
        rubbing[slow & (sign * recording.velocity[samples, joint] > 0)] for sign in (1.0, -1.0)
    ]
    if min(len(side) for side in sides) * samples_step(samples) < MOVED * recording.rate:
        return known
    return max(known, 0.5 * abs(float(np.median(sides[0]) - np.median(sides[1]))))


def driven(recording: Recording, joint: int, samples: np.ndarray) -> np.ndarray:
    """Return which samples lie outside holds: there its motor moves the joint, (s,)."""
    driven = np.ones(len(samples), dtype=bool)
    for piece in recording.slices:
        for hold in recording.held(joint, piece):
            driven &= (samples < piece.start + hold.start) | (samples >= piece.start + hold.stop)
    return driven


def samples_step(samples: np.ndarray) -> int:
    return int(np.median(np.diff(samples)))
