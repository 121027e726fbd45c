"""What a person plots of a residual first: the signals it depends on, its spectra, its lags.

Shares are of the variance of the low-passed residual that piecewise-linear functions of one signal
explain, less what as many functions of nothing would (adjusted R2). They describe; names come from
tracing alone, which tests on trials that were left out.
"""

from typing import Any

import numpy as np
from scipy.signal import coherence

from analysis.closeloop.identification.balance.model import Model, prediction
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.hat_basis import hat_basis
from analysis.closeloop.session.recording import Recording
from sim.effects.motion import travel

#: Largest lag of the whiteness test, s, and how sure its bounds are (two sides).
LAGS, QUANTILE = 1.0, 1.96
#: Orders of the spectrum over position, periods in the range of motion.
ORDERS = np.arange(1.5, 40.0, 0.25)


def diagnose(model: Model, coefficients: np.ndarray, rows: Rows, joint: int) -> dict[str, Any]:
    """Describe one joint's residual under a fitted model.

    Args:
        model: declared or repaired.
        coefficients: its fit.
        rows: the samples that were fitted.
        joint: column number.

    Returns:
        `depends_on` (share of variance per signal), `order` (strongest period over position),
        `coherence` (with the motion, and where), `whiteness` (share of lags outside their bounds).
    """
    recording = model.recording
    residual = (
        recording.effort[:, joint]
        - recording.filtered(np.nan_to_num(prediction(model, coefficients)[:, [joint]]))[:, 0]
    )
    samples = rows.samples[joint]
    own = residual[samples]
    shares = {
        name: explained(signal[samples], own) for name, signal in signals(recording, joint).items()
    }
    return {
        "depends_on": dict(sorted(shares.items(), key=lambda pair: -pair[1])),
        "order": _order(recording, joint, samples, own),
        "coherence": _coherence(recording, joint, residual),
        "whiteness": whiteness([residual[p] for p in _fitted(recording, joint)], recording),
    }


def signals(recording: Recording, joint: int) -> dict[str, np.ndarray]:
    """Return the signals that a residual is plotted against, each (n,)."""
    q, v, a = (
        x[:, joint] for x in (recording.position, recording.velocity, recording.acceleration)
    )
    return {
        "velocity sign": np.tanh(v / recording.rest_speed[joint]),
        "velocity": v,
        "position": q,
        "acceleration": a,
        "load": np.abs(recording.static[:, joint]),
        "command": recording.effort[:, joint],
        "time since reversal": recording.since_reversal(joint),
        "time": recording.time,
    }


def explained(signal: np.ndarray, residual: np.ndarray) -> float:
    """Return the adjusted share of the residual's variance that a signal explains, 0 to 1."""
    good = np.isfinite(signal) & np.isfinite(residual)
    bases = hat_basis(signal[good])
    count, width = bases.shape
    if width == 0 or count < 10 * width:
        return 0.0
    table = np.column_stack([np.ones(count), bases])
    target = residual[good]
    left = target - table @ np.linalg.lstsq(table, target, rcond=None)[0]
    spread = float(((target - target.mean()) ** 2).sum())
    share = 1.0 - float((left**2).sum()) / max(spread, 1e-300) * (count - 1) / (count - width - 1)
    return float(max(0.0, share))


def whiteness(residuals: list[np.ndarray], recording: Recording) -> dict[str, float]:
    """Return the share of the residual's lags outside their bounds, and the share by chance.

    The low-pass alone correlates neighbours, so lags within its memory are left out, and the bounds
    of the others are Bartlett's: 1.96 sqrt(sum rho^2 / n) with the memory's own correlations.

    Args:
        residuals: low-passed, one array per piece.
        recording: its rates.
    """
    memory = int(2.0 * recording.rate / recording.sampling.fit_cutoff)
    most = int(LAGS * recording.rate)
    count = 0
    total = np.zeros(most + 1)
    for residual in residuals:
        if len(residual) <= 2 * most:
            continue
        centred = residual - residual.mean()
        size = 2 ** int(np.ceil(np.log2(2 * len(centred))))
        power = np.abs(np.fft.rfft(centred, size)) ** 2
        total += np.fft.irfft(power)[: most + 1]
        count += len(centred)
    if not count or total[0] <= 0 or memory >= most:
        return {"outside": 0.0, "by_chance": 0.05, "lags": 0}
    rho = total / total[0]
    bound = QUANTILE * np.sqrt((1.0 + 2.0 * float((rho[1:memory] ** 2).sum())) / count)
    far = np.abs(rho[memory:])
    return {"outside": float(np.mean(far > bound)), "by_chance": 0.05, "lags": len(far)}


def _fitted(recording: Recording, joint: int) -> list[slice]:
    return [
        piece
        for piece in recording.slices
        if recording.trial_of(piece) in recording.fit_trials
        and not np.isnan(recording.effort[piece, joint]).any()
    ]


def _order(
    recording: Recording, joint: int, samples: np.ndarray, residual: np.ndarray
) -> dict[str, float]:
    """Return the strongest period over position.

    Its order (periods a turn, or rad/m), amplitude and clearness.
    """
    if not len(samples):
        return {"order": 0.0, "amplitude": 0.0, "over_median": 0.0}
    _, half = travel(recording.position[:, joint])
    step = max(1, len(samples) // 4000)
    position = recording.position[samples[::step], joint]
    torque = residual[::step] - residual.mean()
    orders = ORDERS * np.pi / half
    lines = np.array([abs(np.mean(torque * np.exp(-1j * o * position))) for o in orders])
    best = int(np.argmax(lines))
    return {
        "order": float(orders[best]),
        "amplitude": 2.0 * float(lines[best]),
        "over_median": float(lines[best] / max(float(np.median(lines)), 1e-300)),
    }


def _coherence(recording: Recording, joint: int, residual: np.ndarray) -> dict[str, Any]:
    """Return the highest coherence with a signal of the motion below the fit's low-pass."""
    best: dict[str, Any] = {"with": None, "value": 0.0, "frequency": 0.0}
    pieces = [p for p in _fitted(recording, joint) if p.stop - p.start >= 4 * recording.rate]
    if not pieces:
        return best
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    window = max(64, (longest.stop - longest.start) // 6)
    for name, signal in (
        ("position", recording.position[:, joint]),
        ("velocity", recording.velocity[:, joint]),
        ("acceleration", recording.acceleration[:, joint]),
        ("command", recording.effort[:, joint]),
    ):
        if not np.ptp(signal[longest]):
            # A joint that is held has no spectrum to be coherent with.
            continue
        frequency, value = coherence(
            signal[longest], residual[longest], recording.rate, nperseg=window
        )
        inside = (frequency > 0) & (frequency < recording.sampling.fit_cutoff)
        if inside.any() and value[inside].max() > best["value"]:
            at = int(np.argmax(np.where(inside, value, 0.0)))
            best = {"with": name, "value": float(value[at]), "frequency": float(frequency[at])}
    return best
