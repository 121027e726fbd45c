"""What is left that no catalogued effect explains: described, never given a physical name."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.signal import welch

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.accuracy import TrialError
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.session.recording import Recording

#: A trial or a moment whose residual is this many times the usual one stands out.
ODD = 1.5
ODD_SECONDS = 0.25


def unexplained(
    found: Trace,
    errors: list[TrialError],
    beyond: Mapping[int, list[Peak]],
    verdict: Verdict,
) -> dict[str, Any]:
    """Describe, per joint, what no effect explains: size, signals it depends on, band, where.

    Args:
        found: the trace.
        errors: of the repaired model, over the trials that were fitted and the holdouts.
        beyond: lines and bands in the residual's spectrum.
        verdict: of the whole session.
    """
    recording, left = found.rows.recording, found.ceiling_after
    entries = {}
    for joint in recording.joints:
        name = recording.name(joint)
        depends = [signal for signal, _ in left.depends_on]
        if joint in beyond:
            depends.append("time")
        if not depends and verdict != Verdict.UNEXPLAINED:
            continue
        own = [error for error in errors if error.joint == joint and len(error.time) > 1]
        if not own:
            continue
        share = max(0.0, 1.0 - left.ceiling_loss / max(left.model_loss, 1e-300))
        structured = share * smooth_part(found, joint)
        structured += sum(peak.rms**2 for peak in beyond.get(joint, []))
        # A trial that leaves far more than the fitted ones holds something they did not show.
        usual = float(np.median([_mean_square(e) for e in own if e.trial in recording.fit_trials]))
        odd = [error for error in own if _mean_square(error) > ODD**2 * usual]
        structured = max([structured, *(_mean_square(error) - usual for error in odd)])
        entries[name] = {
            "rms": float(np.sqrt(structured)),
            "unit": recording.device.unit(name),
            "depends_on": list(dict.fromkeys(depends)),
            "band_hz": _band(recording, own, [] if odd else beyond.get(joint, [])),
            "mostly_in": [_where(recording, error, usual) for error in odd],
        }
    return entries


def _mean_square(error: TrialError) -> float:
    return float(np.mean(error.residual**2))


def _where(recording: Recording, error: TrialError, usual: float) -> dict[str, Any]:
    """Say in which file, and from when to when, a trial's residual is larger than usual."""
    count = max(1, int(ODD_SECONDS * recording.sampling.recorded))
    power = np.convolve(error.residual**2, np.full(count, 1.0 / count), mode="same")
    rows = np.flatnonzero(power > ODD**2 * usual)
    first, last = (rows[0], rows[-1]) if len(rows) else (0, len(power) - 1)
    return {
        "file": recording.session.trials[error.trial].file,
        "rms": float(np.sqrt(_mean_square(error))),
        "time": [float(error.time[first]), float(error.time[last])],
    }


def _band(recording: Recording, errors: list[TrialError], beyond: list[Peak]) -> list[float]:
    """Return where 80 % of the residual's power above the white floor lies, Hz."""
    if beyond:
        return [min(peak.low_hz for peak in beyond), max(peak.high_hz for peak in beyond)]
    rate = recording.sampling.recorded
    worst = max(errors, key=_mean_square)
    frequency, power = welch(worst.residual, rate, nperseg=min(len(worst.time), int(4 * rate)))
    above = np.maximum(power - np.median(power[len(power) // 2 :]), 0.0)
    total = np.cumsum(above) / max(float(above.sum()), 1e-300)
    low, high = np.searchsorted(total, [0.1, 0.9])
    return [float(frequency[low]), float(frequency[min(high, len(frequency) - 1)])]


def smooth_part(found: Trace, joint: int) -> float:
    """Return the mean square of a joint's low-passed residual under the final model."""
    rows, part = found.rows, found.rows.parts[joint]
    base, _ = found.model.base(rows)
    left = found.model.target(rows) - base @ found.score.coefficients
    if not len(left[part]):
        return 0.0
    return float(np.mean((left[part] / rows.weight[part]) ** 2))
