"""Whether an effect that was added to a model is there at all, by its own size."""

import numpy as np
from scipy.stats import f

from analysis.closeloop.contract import CONFIDENCE
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.balance.uncertainty import Fits
from sim.effects.catalogue import BY_NAME

ZERO = BY_NAME["position_offset"]


def surely_there(fits: Fits, model: Model, coefficients: np.ndarray, candidate: Candidate) -> float:
    """Return how sure it is that an added effect is there at all; up to 1 it may be nothing.

    What passes the effort on, as a delay does, has one size at every place, and its interval may
    not hold zero. So has a wrong zero of a robot's joint. Of other effects the law is an
    approximation, and an interval that holds what an error of form does says how large they are,
    not whether they are. One of their coefficients has to be beyond its 90 % interval over trials,
    or all of them beyond their common region: a drift's rate and its beginning are known together
    where neither is alone. (Chosen while looking at the asymmetry of EMPS's friction, at the
    inertia of elbows, and at a pair with an end-range torque; the region while looking at drifts of
    the unkind bench, limb 3074 and arm 12218, tuning seeds; the zero at two arms of an opponent.)

    Args:
        fits: of `model`, from `leave_out`; with the form held, for that of no effect means nothing
            (Davies 1977, Hypothesis testing when a nuisance parameter is present only under the
            alternative).
        model: with the effect.
        coefficients: its fit.
        candidate: the effect and its joint.
    """
    for channel in model.channels:
        if channel.candidate == candidate:
            sizes = [(v, fits.thetas.get((*candidate.key, n))) for n, v in channel.theta.items()]
            beyond = [
                abs(value) / max(np.abs(np.subtract(fits.interval(found, value), value)))
                for value, found in sizes
                if found is not None
            ]
            return max(beyond, default=0.0)
    sure = [0.0]
    for (term, own), (_, every) in zip(
        model.split(coefficients), model.split(fits.coefficients), strict=True
    ):
        if term.candidate != candidate:
            continue
        if candidate.effect is ZERO and candidate.joint not in model.recording.limbs:
            ends = fits.interval(every[:, 0], float(own[0]))
            return float(abs(own[0]) / np.abs(np.subtract(ends, own[0])).max())
        sure += [_sure(fits, own[[one]], every[:, [one]]) for one in range(len(own))]
        sure.append(_sure(fits, own, every))
    return max(sure)


def _sure(fits: Fits, values: np.ndarray, found: np.ndarray) -> float:
    """Return how far coefficients are from zero, over how far their 90 % region over trials goes.

    Of one coefficient that is Student's interval, of several Hotelling's ellipsoid (1931, The
    generalization of Student's ratio). Not over places: what acts at the end of the range alone, no
    other place knows.

    Args:
        fits: of the model.
        values: of the coefficients, (k,).
        found: the same of every fit, (fits, k).

    Returns:
        The ratio; 0 where fewer clusters than coefficients tell nothing.
    """
    size, trials = len(values), fits.left_out(found)[0]
    freedom = len(trials) - size
    if freedom <= 0:
        return 0.0
    moved = trials - found[0]
    if np.any((values != 0.0) & ~moved.any(axis=0)):
        # All fits end at its bound. (A vendor's friction of 1 Nm where there is 0.02.)
        return np.inf
    scale = np.maximum(np.sqrt((moved**2).sum(axis=0)), 1e-300)
    spread = (moved / scale).T @ (moved / scale) * (len(trials) - 1) / len(trials)
    distance = float(values / scale @ np.linalg.pinv(spread, hermitian=True) @ (values / scale))
    most = size * (len(trials) - 1) / freedom * float(f.ppf(CONFIDENCE, size, freedom))
    return float(np.sqrt(distance / most))
