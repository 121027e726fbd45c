"""How much structure is explainable at all: splines on the recorded signals, with no physics.

It sets the floor that a repaired model can reach, tells when a named effect explains too little of
what is there, and says on which signals the rest depends. Folds are scattered blocks of time, not
groups: a spline may interpolate between speeds, and must not be asked to extrapolate.
"""

import numpy as np

from analysis.closeloop.identification.balance.least_squares import keep_independent
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    Variant,
    compare,
    rank_z,
    scattered_folds,
    score,
)
from analysis.closeloop.identification.findings import Explainable
from analysis.closeloop.identification.hat_basis import hat_basis
from analysis.closeloop.identification.presliding import with_free_presliding
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms


def signal_groups(rows: Rows, joint: int) -> dict[str, np.ndarray]:
    """Return the bases of each recorded signal that may explain a joint's residual, (n, k)."""
    recording = rows.recording
    name = recording.name(joint)
    q, v, a = (
        x[:, joint] for x in (recording.position, recording.velocity, recording.acceleration)
    )
    sign = np.tanh(v / (2.0 * recording.rest_speed[joint]))
    groups = {
        f"{name}.position": hat_basis(q, 10),
        f"{name}.velocity": np.column_stack(
            [sign, np.tanh(v / (0.1 * recording.top_speed[joint])), hat_basis(v, 10)]
        ),
        f"{name}.acceleration": hat_basis(a, 6),
        f"{name}.position x velocity": np.column_stack(
            [hat_basis(q, 8) * sign[:, None], hat_basis(q, 12) * v[:, None]]
        ),
        "time": hat_basis(recording.time, 5),
        "time in trial": hat_basis(_time_in_trial(recording), 5),
        "time x motion": _with_motion(hat_basis(recording.time, 4), q, v),
    }
    for other in range(recording.position.shape[1]):
        if other != joint and np.ptp(recording.position[:, other]) > 5e-3:
            groups[f"{recording.name(other)}.position"] = np.column_stack(
                [
                    hat_basis(recording.position[:, other], 5),
                    recording.velocity[:, [other]],
                    recording.acceleration[:, [other]],
                ]
            )
    for number, extra in enumerate(recording.extra_names):
        bases = hat_basis(recording.extra[:, number], 5)
        groups[extra] = bases
        groups[f"{extra} x motion"] = _with_motion(bases, q, v)
    return groups


def _time_in_trial(recording: Recording) -> np.ndarray:
    """Return the time since each sample's trial began, s."""
    begin = np.full(int(recording.trial.max()) + 1, np.inf)
    np.minimum.at(begin, recording.trial, recording.time)
    return np.asarray(recording.time - begin[recording.trial])


def _with_motion(bases: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the bases of a stiffness and a damping that change with a signal, (n, 2 k)."""
    return np.concatenate([bases * position[:, None], bases * velocity[:, None]], axis=1)


def phase_groups(recording: Recording, joint: int) -> dict[str, np.ndarray]:
    """Return bases of where in its course a movement is, which no instant's motion tells, (n, k).

    What stores something (a spring, a slack strap) shows after a reversal or where the load turns;
    what is late shows with the rate at which torque changes.
    """
    name = recording.name(joint)
    turned = recording.since_reversal(joint)
    after = hat_basis(np.log(np.abs(turned) + 0.02), 7)
    load = recording.inverse[:, joint]
    pull = np.tanh(load / max(0.1 * float(np.std(load)), 1e-12))
    rate = recording.derivative(recording.smoothed(recording.inverse[:, [joint]]))
    return {
        "time since reversal": after * np.sign(turned)[:, None],
        f"{name}.effort": np.column_stack([hat_basis(load, 8), pull, rate, np.abs(rate)]),
    }


def explainable(model: Model, rows: Rows) -> Explainable:
    """Fit every spline beside the model, and each signal's alone.

    Args:
        model: the declared or repaired model.
        rows: the samples to fit, weighted by each joint's noise (or not at all at first).
    """
    model = with_free_presliding(model, model.recording.joints)
    folds = scattered_folds(rows)
    plain = evaluate(model, rows, fold_rows=folds)
    base, lower = model.base(rows)
    target = model.target(rows)
    everything: list[np.ndarray] = []
    singles: dict[str, list[np.ndarray]] = {}
    for joint in rows.samples:
        for name, bases in signal_groups(rows, joint).items():
            stacked = rows.stack(model.transformed({joint: bases}), bases.shape[1])
            everything.append(stacked)
            singles.setdefault(name, []).append(stacked)
    full = _with(rows, target, base, lower, np.concatenate(everything, axis=1), folds)
    gain, error = compare(plain.losses, full.losses)
    shares = []
    if gain > 3 * error:
        for name, parts in singles.items():
            alone = _with(rows, target, base, lower, np.concatenate(parts, axis=1), folds)
            own, own_error = compare(plain.losses, alone.losses)
            if own > 3 * own_error and own > 0.25 * gain:
                shares.append((name, own / gain))
    noise = {}
    left = target - np.column_stack([base, full.variant.columns]) @ full.coefficients
    for joint, part in rows.parts.items():
        # In the joint's unit, and never zero: a perfect recording still has its last digit.
        spread = rms(left[part] / rows.weight[part])
        scale = rms(target[part] / rows.weight[part])
        noise[joint] = max(spread, 1e-5 * scale, 1e-9)
    return Explainable(
        model_loss=plain.loss,
        splines_loss=min(full.loss, plain.loss),
        z=gain / error,
        rank_z=rank_z(plain.losses, full.losses),
        depends_on=tuple(sorted(shares, key=lambda pair: -pair[1])[:3]),
        noise=noise,
    )


def _with(
    rows: Rows,
    target: np.ndarray,
    base: np.ndarray,
    lower: np.ndarray,
    columns: np.ndarray,
    folds: list[np.ndarray],
) -> Score:
    kept, numbers = keep_independent(base, columns)
    variant = Variant(theta={}, columns=kept, kept=numbers)
    return score(rows, target, base, lower, [variant], (-np.inf,), fold_rows=folds)
