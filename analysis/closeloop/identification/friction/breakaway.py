"""Friction that a joint shows at rest and hardly in motion: it breaks away late, and then slides.

A joint passes the speeds at which Stribeck's excess is lost in milliseconds, and the low-pass that
its noise asks for takes most of what is left of it. At rest the same friction holds whatever the
motor happens to apply, up to its breakaway level (Armstrong-Helouvry, Dupont and Canudas de Wit
1994, section 2): more than the friction in motion where there is an excess, never more elsewhere.
A rest that is left slowly takes that level, too, where a quick start passes it in milliseconds;
what a brake held, or a person who leaned on the arm, it does not take.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from analysis.closeloop.identification.balance.accuracy import raw_errors
from analysis.closeloop.identification.balance.luck import MIN_TORQUE, MIN_Z
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    one_joint,
    prediction,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate, Given, Term
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.nameable import beyond_physics, lowest
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import REST, runs
from analysis.closeloop.session.signals import rms
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.friction import GAUSSIAN

STRIBECK, COULOMB = BY_NAME["stribeck_friction"], BY_NAME["coulomb_friction"]
MOTOR = BY_NAME["coupled_motor"]
#: Speeds at which the excess may be lost, over the top speed. No motion shows lower ones.
SPEEDS = np.geomspace(0.004, 0.4, 21)
#: What is held for so long is no reversal, s.
HELD = 2.0 * REST
#: What a rest is left with is the most over so long, s: an excess is lost in some hundredths.
PEAK = 0.02
#: Rests that have to hold a level, and the share of an excess by which they may differ. (Set while
#: looking at seven arms of an opponent, two of them without an excess.)
SEVERAL, ALIKE = 3, 0.1
NOTE = (
    "stribeck_friction of {}: at rest it holds {:.3g} {} to either side and slides with {:.3g}; "
    "the excess is known from the rests, and is at least the difference"
)


#: Torques to the positive and to the negative side, Nm or N; of many rests, and of one.
Sides = tuple[list[float], list[float]]
Levels = tuple[float, float]
#: Of the starts to either side, the speed soon after, rad/s or m/s, and the torque, Nm or N.
Starts = tuple[list[tuple[float, float]], list[tuple[float, float]]]


@dataclass(frozen=True)
class Held:
    """What a joint holds at rest, to the side where it is less, and slides with; Nm or N."""

    level: float
    sliding: float
    #: The most that it took to leave a rest slowly, to the side where that is less.
    leaving: float
    #: By how much rests differ that hold the most, and both sides.
    apart: float
    #: Root mean square of what the model leaves of the joint in the faster half of its motion,
    #: where no excess is left of it.
    error: float

    @property
    def z(self) -> float:
        """What is held beyond the sliding friction, in errors."""
        return (self.level - self.sliding) / self.error

    @property
    def breaks_away(self) -> bool:
        """Whether leaving a rest takes what is held rather than what sliding takes.

        Or several rests hold the same to both sides, which a low-pass that takes the peak of a
        start leaves: a brake holds whatever it is given.
        """
        alike = self.apart < ALIKE * (self.level - self.sliding)
        return alike or self.leaving > 0.5 * (self.level + self.sliding)


@dataclass(frozen=True)
class Rest:
    """From and to when a joint rests, s, and how fast it is soon after; 0 if nobody knows."""

    time: tuple[float, float]
    speed: float


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


def held_levels(torque: np.ndarray, width: int) -> Levels:
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


def level_of(levels: list[float]) -> float:
    """Return what several rests hold, or each of a few: the most of many is noise."""
    return sorted(levels)[-min(SEVERAL, len(levels))]


def _held(grown: Grown, rows: Rows, joint: int) -> Held | None:
    """Return what a joint with plain friction holds beyond it at rest; None if that may be none."""
    model, recording = grown.model, rows.recording
    coefficients = np.array(grown.score.coefficients)
    sliding = float(recording.device.friction[joint])
    for term, own in model.split(coefficients):
        if term.joint != joint or term.effect is None:
            continue
        if term.effect is MOTOR and 0 in term.kept:
            # Its friction holds the joint, too, where it does not turn.
            sliding += float(own[term.kept.index(0)])
            own[term.kept.index(0)] = 0.0
        if not term.rubs or term.effect.winds:
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
    held, left = _at_rests(recording, joint, expected)
    if not all(left):
        return None
    # To either side: what a wrong offset or gravity adds to one it takes from the other.
    levels = [level_of(side) for side in held]
    several = len(held[0]) >= SEVERAL
    found = Held(
        level=min(levels),
        sliding=sliding,
        apart=max(max(side) for side in held) - min(levels) if several else np.inf,
        leaving=min(_slowly(side) for side in left),
        error=_error_in_motion(grown, rows, joint),
    )
    least = MIN_TORQUE * rms(recording.effort[rows.samples[joint], joint])
    seen = found.z > MIN_Z and found.level - sliding > least
    return found if seen and found.breaks_away else None


def _error_in_motion(grown: Grown, rows: Rows, joint: int) -> float:
    """Return the root mean square of what the model leaves in the faster half of the samples."""
    part = rows.parts[joint]
    expected = grown.model.base(rows)[0][part] @ np.array(grown.score.coefficients)
    left = (grown.model.target(rows)[part] - expected) / rows.weight[part]
    speed = np.abs(rows.recording.velocity[rows.samples[joint], joint])
    return rms(left[speed >= np.median(speed)])


def _slowly(left: list[tuple[float, float]]) -> float:
    """Return the most that the slower half of starts took, of each its speed and its torque."""
    return max(torque for _, torque in sorted(left)[: (len(left) + 1) // 2])


def _at_rests(recording: Recording, joint: int, expected: np.ndarray) -> tuple[Sides, Starts]:
    """Return what each rest holds, and how it is left, to either side.

    Args:
        recording: the trials.
        joint: its number.
        expected: effort without the joint's friction, (n, joints).
    """
    # The fit's low-pass would overshoot where a torque changes its side.
    errors = raw_errors(recording.of_joint(joint), expected, recording.fit_trials)
    rate = recording.sampling.recorded
    held: Sides = ([], [])
    left: Starts = ([], [])
    for error in errors:
        for rest in _rests(recording, joint, error.trial):
            for side, level in zip(held, _most(error, *rest.time, HELD * rate), strict=True):
                side.append(level)
            if rest.speed:
                stop, negative = rest.time[1], rest.speed < 0.0
                taken = _most(error, stop - HELD, stop + HELD, PEAK * rate)
                left[negative].append((abs(rest.speed), taken[negative]))
    return held, left


def _most(error: TrialError, start: float, stop: float, width: float) -> Levels:
    """Return the most of what a model leaves of a trial over `width` samples of a stretch, s."""
    within = slice(*np.searchsorted(error.time, (start, stop)))
    return held_levels(error.residual[within], max(2, round(width)))


def _rests(recording: Recording, joint: int, trial: int) -> Iterator[Rest]:
    """Yield the rests of a joint in a trial that nothing disturbs."""
    for piece in recording.pieces_of(trial):
        still = recording.resting(joint, piece)
        resting = still & recording.usable[piece]
        if recording.disturbed is not None:
            resting &= ~recording.disturbed[piece, joint]
        resting[: recording.edge] = False
        resting[len(resting) - recording.edge :] = False
        clock, velocity = recording.time[piece], recording.velocity[piece, joint]
        soon = max(1, round(HELD * recording.rate))
        for rest in runs(resting):
            after = rest.stop + soon - 1
            known = after < len(still) and not still[rest.stop]
            speed = float(velocity[after]) if known else 0.0
            yield Rest((float(clock[rest.start]), float(clock[rest.stop - 1])), speed)


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
        theta = {"smooth": min([*turning, 0.4 * speed]), "speed": float(speed), "power": GAUSSIAN}
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
