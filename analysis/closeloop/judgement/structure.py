"""Whether a residual still goes with something: time, phase, speed, position, other signals.

For each group of splines a score test of the fitted model: how much of the residual they explain,
next to what they explain when each second of it is given a random sign. Signs leave alone what
noise has, whatever its colour and wherever it is large (the wild bootstrap by clusters, Cameron,
Gelbach and Miller 2008, Bootstrap-based improvements for inference with clustered errors), and what
comes back in every second they cancel. Unlike held-out gain it asks for no form that predicts, so
it sees what is left of a shape that no spline has.
"""

import numpy as np
from scipy.stats import gamma

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.explainable import phase_groups, signal_groups
from analysis.closeloop.identification.findings import Structure
from analysis.closeloop.identification.presliding import with_free_presliding

#: Random signs of every second, and how rare a share has to be, over all groups of a joint.
SIGNS, CHANCE = 400, 1e-4
#: Fewest seconds that can say anything.
MIN_BLOCKS = 8


def structures(model: Model, rows: Rows) -> dict[int, list[Structure]]:
    """Return the signals that each joint's residual goes with, the strongest first.

    Args:
        model: declared or repaired; it is fitted again with friction free around zero speed.
        rows: the samples to look at.
    """
    model = with_free_presliding(model, model.recording.joints)
    base, _ = model.base(rows)
    target = model.target(rows)
    span = np.linalg.qr(base)[0] if base.shape[1] else base
    residual = target - span @ (span.T @ target)
    found: dict[int, list[Structure]] = {}
    for joint, part in rows.parts.items():
        if not len(rows.samples[joint]):
            continue
        groups = signal_groups(rows, joint) | phase_groups(rows.recording, joint)
        tests = {}
        for name, bases in groups.items():
            stacked = rows.stack(model.transformed({joint: bases}), bases.shape[1])
            tests[name] = score_test(stacked, span, residual, part, rows.block)
        unit = 1.0 / rows.weight[part.start]
        found[joint] = sorted(
            (
                Structure(signal=name, rms=size * unit, p_value=chance)
                for name, (size, chance) in tests.items()
                if chance < CHANCE / len(groups)
            ),
            key=lambda one: -one.rms,
        )
    return found


def score_test(
    columns: np.ndarray, span: np.ndarray, residual: np.ndarray, part: slice, block: np.ndarray
) -> tuple[float, float]:
    """Return what columns explain of a residual, root mean square beyond chance, and its p-value.

    Args:
        columns: (r, k).
        span: orthonormal columns of the model, (r, b).
        residual: of the model's fit, (r,).
        part: the rows of one joint.
        block: numbers of seconds, (r,).
    """
    left = (columns - span @ (span.T @ columns))[part]
    left = left / np.maximum(np.sqrt((columns[part] ** 2).sum(axis=0)), 1e-300)
    values, vectors = np.linalg.eigh(left.T @ left)
    kept = values > 1e-6
    if not kept.any():
        return 0.0, 1.0
    basis = left @ (vectors[:, kept] / np.sqrt(values[kept]))
    _, seconds = np.unique(block[part], return_inverse=True)
    count = int(seconds.max()) + 1
    if count < MIN_BLOCKS:
        return 0.0, 1.0
    products = np.zeros((count, basis.shape[1]))
    np.add.at(products, seconds, basis * residual[part, None])
    whole = float((products.sum(axis=0) ** 2).sum())
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (SIGNS, count))
    drawn = ((signs @ products) ** 2).sum(axis=1)
    mean, spread = float(drawn.mean()), float(drawn.var()) + 1e-300
    chance = float(gamma.sf(whole, mean**2 / spread, scale=spread / max(mean, 1e-300)))
    size = np.sqrt(max(whole - mean, 0.0) / (part.stop - part.start))
    return float(size), chance
