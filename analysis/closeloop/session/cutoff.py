"""The cutoff of the positions' low-pass: how much of the encoder's noise the torque can bear.

Accelerations are second derivatives, so the noise of a position that passes the filter becomes
noise of the torque that the chain needs. The encoder's spectrum says up to where motion stands out
at all; the torque itself says what of that helps: the recorded torque, unfiltered, is predicted in
stretches of time that no fit has seen, at one cutoff after the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np
from scipy.signal import welch

from analysis.closeloop.session.contents import Session
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.signals import Sampling, derivatives, rms, sampling_at

#: Cutoffs that are tried, Hz, and the bounds of what the encoder's spectrum may say.
GRID = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0)
ENCODER = (8.0, 60.0)
#: Cutoff over the recorded rate. Up to the first, accelerations at half of it, the fit's cutoff,
#: are right to 0.2 % (`signals.slope`); at the second they are 1 % small: the torque has to ask.
CAREFUL, MOST = 0.2, 0.3
#: Share by which the error may exceed its least over the octave below, and by which no model that
#: lacks something does: set on recordings of UR10e, Panda, a double pendulum and EMPS, and on the
#: full simulation of an arm in its tissue.
TOLERANCE, NOISE = 0.002, 0.02
#: Samples on which a cutoff is judged, length of a block of time, s, and folds.
ROWS, BLOCK, FOLDS = 3000, 1.0, 5
#: Ends of a stretch that are not judged, s.
EDGE = 0.25
#: Direction of the motion changes over this share of the usual speed.
SMOOTH = 0.02


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """An evenly sampled piece of a trial at the recorded rate; arrays have shape (n, joints)."""

    trial: int
    time: np.ndarray
    position: np.ndarray
    #: NaN where a joint has no effort.
    effort: np.ndarray
    #: (n, extra columns), NaN where the trial lacks one.
    extra: np.ndarray
    #: Whether a sample was recorded there, (n,); what stands at others is interpolated.
    measured: np.ndarray


def choose_sampling(
    pieces: Sequence[Stretch],
    rate: float,
    session: Session,
    device: Device,
    joints: Sequence[int],
) -> Sampling:
    """Choose the kinematic cutoff.

    From high cutoffs to low the error of the predicted torque falls as long as the encoder's noise
    matters. The cutoff is the highest from which the octave below brings no further `TOLERANCE`.
    One lower still that predicts better smooths motion, not noise: that can imitate an effect that
    the model lacks, such as a late motor. Such an error grows ever less with the cutoff, that of
    noise ever more, so a gain of less than `NOISE` is noise only if the error grows faster than an
    octave below.

    Where motion stands out beyond a fifth of the rate, slopes are less exact: a cutoff there has to
    predict the torque better by `NOISE`.

    Args:
        pieces: stretches of the trials that may be fitted.
        rate: at which they were recorded, Hz.
        session: its own cutoff is taken as it is.
        device: the declared chain.
        joints: columns of those that move and have an effort.
    """
    if session.kinematic_cutoff_hz is not None:
        return sampling_at(min(session.kinematic_cutoff_hz, 0.4 * rate), rate, "session.json")
    clear = encoder_cutoff([piece.position[:, joints] for piece in pieces], rate)
    highest = min(clear, CAREFUL * rate)
    tried = [*(cutoff for cutoff in GRID if cutoff < 0.99 * highest), highest]
    errors: dict[float, float] = {}

    def error(cutoff: float) -> float:
        if cutoff not in errors:
            errors[cutoff] = torque_error(cutoff, pieces, rate, session, device, joints)
        return errors[cutoff]

    for cutoff in reversed(tried):
        if not noisy(cutoff, tried, error):
            break
    if cutoff == highest < clear:
        beyond = [*(other for other in GRID if highest < other < 0.99 * clear), clear]
        best = min(beyond, key=error)
        if error(best) < (1.0 - NOISE) * error(highest):
            return sampling_at(best, rate, "torque")
    return sampling_at(cutoff, rate, "encoder" if cutoff == highest else "torque")


def noisy(cutoff: float, tried: Sequence[float], error: Callable[[float], float]) -> bool:
    """Whether the encoder's noise shows at a cutoff.

    Args:
        cutoff: one of those tried, Hz.
        tried: cutoffs in rising order, Hz.
        error: of the predicted torque at each.
    """
    octave = [lower for lower in tried if cutoff / 2.0 <= lower <= cutoff]
    excess = error(cutoff) / min(map(error, octave)) - 1.0
    if not TOLERANCE < excess <= NOISE or octave[0] == tried[0]:
        return excess > TOLERANCE

    def growth(at: int) -> float:
        """Return how fast the error grows towards a cutoff, over octaves."""
        low, high = tried[at - 1], tried[at]
        return log(error(high) / error(low)) / log(high / low)

    return growth(tried.index(cutoff)) > growth(tried.index(octave[0]))


def encoder_cutoff(positions: Sequence[np.ndarray], rate: float) -> float:
    """Return where motion sinks into the encoder's noise, Hz.

    Args:
        positions: of every stretch, (n, joints) each.
        rate: at which they were recorded, Hz.
    """
    highest = ENCODER[0]
    for position in positions:
        for signal in position.T:
            if np.ptp(signal) < 1e-6 or len(signal) < 64:
                continue
            window = min(len(signal), max(64, int(4.0 * rate)))
            frequency, power = welch(signal, rate, nperseg=window, detrend="linear")
            floor = float(np.median(power[frequency > 0.25 * rate]))
            clear = power > 20.0 * floor
            # The first frequency from which on motion no longer stands out.
            end = int(np.argmin(clear[1:])) + 1 if not clear[1:].all() else len(clear) - 1
            highest = max(highest, 1.5 * float(frequency[end]))
    return min(highest, ENCODER[1], MOST * rate)


def torque_error(
    cutoff: float,
    pieces: Sequence[Stretch],
    rate: float,
    session: Session,
    device: Device,
    joints: Sequence[int],
) -> float:
    """Return the error of the raw torque that left-out blocks of time are predicted with.

    Per joint, the declared torque, a constant, position, velocity, its direction and acceleration
    are fitted together; the joints' errors are averaged geometrically.

    Args:
        cutoff: of the positions, Hz.
        pieces: stretches of the trials that may be fitted.
        rate: of the stretches, Hz.
        session: masses that its trials carried.
        device: the declared chain.
        joints: columns of those that move and have an effort.
    """
    plain = Sampling(recorded=rate, working=rate, cutoff=cutoff)
    step = max(1, sum(len(piece.time) for piece in pieces) // ROWS)
    tables: list[np.ndarray] = []
    efforts: list[np.ndarray] = []
    blocks: list[np.ndarray] = []
    for piece in pieces:
        edge = min(int(EDGE * rate), len(piece.time) // 4)
        rows = np.arange(edge, len(piece.time) - edge, step)
        rows = rows[piece.measured[rows]]
        if not len(rows):
            continue
        q, v, a = (signal[rows] for signal in derivatives(piece.position, plain))
        mass = session.trials[piece.trial].added_mass
        torque = device.inverse_dynamics(q, v, a, masses=(mass,) if mass else ())
        tables.append(np.stack([torque, np.ones_like(q), q, v, v, a], axis=2)[:, joints])
        efforts.append(piece.effort[np.ix_(rows, joints)])
        first = blocks[-1][-1] + 1 if blocks else 0
        blocks.append(first + ((piece.time[rows] - piece.time[rows[0]]) // BLOCK).astype(int))
    table, effort = np.concatenate(tables), np.concatenate(efforts)
    fold = np.concatenate(blocks) % FOLDS
    found = [_left_out(table[:, column], effort[:, column], fold) for column in range(len(joints))]
    return exp(sum(log(max(value, 1e-300)) for value in found) / len(found))


def _left_out(columns: np.ndarray, effort: np.ndarray, fold: np.ndarray) -> float:
    """Return the root mean square of what predictions of left-out folds leave of `effort`, (n,)."""
    given = np.isfinite(effort)
    columns, effort, fold = columns[given].copy(), effort[given], fold[given]
    speed = columns[:, 4]
    columns[:, 4] = np.tanh(speed / max(SMOOTH * rms(speed), 1e-12))
    columns /= np.maximum(np.sqrt((columns**2).sum(axis=0)), 1e-300)
    left = np.zeros_like(effort)
    for number in range(FOLDS):
        out = fold == number
        fit = np.linalg.lstsq(columns[~out], effort[~out], rcond=1e-9)[0]
        left[out] = effort[out] - columns[out] @ fit
    return rms(left)
