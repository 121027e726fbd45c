"""The noise ceiling of several joints: each one's own, with what joints share as fitted."""

import numpy as np

from analysis.closeloop.identification.findings import NoiseCeiling
from analysis.closeloop.identification.model import Model, evaluate, one_joint
from analysis.closeloop.identification.noise_ceiling import noise_ceiling
from analysis.closeloop.identification.regression import Rows

#: Share of the whole gain from which on a signal is told.
TOLD = 0.25


def whole_ceiling(model: Model, rows: Rows) -> NoiseCeiling:
    """Return what splines explain at every joint together."""
    coefficients = evaluate(model, rows).coefficients
    found = [
        noise_ceiling(one_joint(model, coefficients, joint), rows.of_joint(joint))
        for joint in rows.samples
    ]
    remains = sum(own.remains for own in found)
    errors = np.array([own.remains / own.z if own.z > 0 else 0.0 for own in found])
    shares: dict[str, float] = {}
    for own in found:
        for name, share in own.depends_on:
            part = share * own.remains / max(remains, 1e-300)
            shares[name] = max(shares.get(name, 0.0), part)
    return NoiseCeiling(
        model_loss=sum(own.model_loss for own in found),
        ceiling_loss=sum(own.ceiling_loss for own in found),
        z=remains / max(float(np.sqrt((errors**2).sum())), 1e-300),
        rank_z=max(own.rank_z for own in found),
        depends_on=tuple(
            sorted(((n, s) for n, s in shares.items() if s > TOLD), key=lambda pair: -pair[1])[:3]
        ),
        noise={joint: noise for own in found for joint, noise in own.noise.items()},
    )
