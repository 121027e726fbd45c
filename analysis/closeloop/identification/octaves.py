"""Whether an effect that filters the motion has one size at every frequency.

A late motor is late at every frequency of the motion, or it is none.

A robot is recorded in closed loop. A torque that nobody knows of (a tremor, a person's push) moves
the joint, and the controller answers: effort and motion are then related by the controller, and a
fit takes some of that for a late motor, or for inertia (Ljung 1999, System Identification, section
13.4; Forssell and Ljung 1999, Closed-loop identification revisited). What passes the motion on like
a linear filter has one size at every frequency; what the controller does in the band of a
disturbance does not go on into the band of the motion. So the octave in which such an effect
explains most is left out, and its size is asked for again.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter1d

from analysis.closeloop.identification.balance.model import Model, evaluate, prediction
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.sticking import samples_step
from analysis.closeloop.identification.balance.terms import Candidate, kept_columns
from analysis.closeloop.identification.spectrum import below
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME

ELASTIC = BY_NAME["series_elasticity"]
#: Least upper edge of an octave, Hz.
LOWEST = 0.5
#: How far an effect's size elsewhere may be from that of the whole fit, over it: of what is late,
#: and of what else filters the motion, since smoothing it takes more of the quick part; and how
#: many standard errors a difference has to be. Set on tremors and on limbs with such an effect,
#: tuning limbs 15005 to 16105 of the unkind bench.
OFF_LATE, OFF, ERRORS = 0.25, 0.5, 3.0
#: Least power of an effect elsewhere, over that in its octave, below which only rounding is left.
LEAST = 1e-9


def differs_elsewhere(model: Model, candidate: Candidate, rows: Rows) -> bool:
    """Whether an effect has another size outside of the octave in which it explains most."""
    found = size_elsewhere(model, candidate, rows)
    if found is None:
        return False
    size, error = found
    return abs(size - 1.0) > max(OFF_LATE if candidate.effect.channel else OFF, ERRORS * error)


def size_elsewhere(model: Model, candidate: Candidate, rows: Rows) -> tuple[float, float] | None:
    """Return an effect's size outside of the octave in which it explains most.

    All coefficients of its joint are fitted again with it. Springs swing against each other: of
    several the torque is asked of all of them, at the joint of this one.

    Args:
        model: with the effect; fitted to the rows.
        candidate: the effect and its joint.
        rows: the samples that were fitted.

    Returns:
        The size over that of the whole fit, and its standard error; None if no octave is left out,
        or nothing of the effect is left elsewhere.
    """
    joint, recording = candidate.joint, rows.recording
    expected = _expected(model, rows, joint)
    together = {candidate, *(c for c in model.effects if c.effect is candidate.effect is ELASTIC)}
    rest = model.keeping(lambda other: other not in together)
    torque = expected - _expected(rest, rows, joint)
    others = np.column_stack([np.empty((len(expected), 0)), *_columns(rest, joint)])
    samples, block = rows.samples[joint], rows.block[rows.parts[joint]]
    left = np.where(_near(samples, len(expected)), recording.effort[:, joint] - expected, 0.0)
    left = np.nan_to_num(left)
    # What only the effect explains, over all of the motion.
    own = torque - others @ np.linalg.lstsq(others[samples], torque[samples])[0]
    powers = {
        edge: float(np.sum(_octave(own[:, None], edge, recording)[samples] ** 2))
        for edge in _upper_edges(recording)
    }
    if not any(powers.values()):
        return None
    most = max(powers, key=lambda edge: powers[edge])
    columns = np.column_stack([own, left, others])
    elsewhere = (columns - _octave(columns, most, recording))[samples]
    beside = elsewhere[:, 2:]
    elsewhere = elsewhere[:, :2] - beside @ np.linalg.lstsq(beside, elsewhere[:, :2])[0]
    torque, rest = elsewhere.T
    power = float(torque @ torque)
    if power <= LEAST * powers[most]:
        return None
    further = float(torque @ rest) / power
    blocks = np.bincount(block, torque * (rest - further * torque))
    return 1.0 + further, float(np.sqrt(blocks @ blocks)) / power


def _near(samples: np.ndarray, count: int) -> np.ndarray:
    """Return which of all samples stand between fitted ones or beside one, (count,).

    What is left where a joint sticks is no size of anything, and filters spread it.
    """
    step = samples_step(samples)
    own = np.zeros(count)
    own[samples] = 1.0
    return np.asarray(maximum_filter1d(own, 2 * (step // 2) + 1) > 0.0)


def _columns(model: Model, joint: int) -> Iterator[np.ndarray]:
    """Yield what the terms of a model bring to a joint, low-passed, (n, k) each."""
    for term in model.terms:
        if joint in term.columns:
            own = {joint: kept_columns(term)[joint]}
            yield model.recording.filtered(model.transformed(own)[joint])


def _upper_edges(recording: Recording) -> Iterator[float]:
    """Yield where octaves end, Hz, by half octaves down from where nothing is left.

    A strong line just above the fit's cutoff is in the fit, too: the low-pass is no wall.
    """
    edge = 2.0 * recording.sampling.fit_cutoff
    while edge >= LOWEST:
        yield edge
        edge /= np.sqrt(2.0)


def _octave(columns: np.ndarray, edge: float, recording: Recording) -> np.ndarray:
    """Return the octave below a frequency, Hz, of columns, (n, k)."""
    upper, lower = (
        below(columns, hertz, recording.rate, recording.slices) for hertz in (edge, edge / 2.0)
    )
    return np.asarray(upper - lower)


def _expected(model: Model, rows: Rows, joint: int) -> np.ndarray:
    torque = prediction(model, evaluate(model, rows).coefficients)[:, [joint]]
    return rows.recording.filtered(torque)[:, 0]
