"""What splines explain at every joint, with what joints share as fitted."""

import numpy as np

from analysis.closeloop.identification.balance.model import Model, evaluate, one_joint
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Explainable

#: Share of the whole gain from which on a signal is told.
TOLD = 0.25


def explainable_by_joint(model: Model, rows: Rows) -> Explainable:
    """Return what splines explain at every joint together."""
    coefficients = evaluate(model, rows).coefficients
    found = [
        explainable(one_joint(model, coefficients, joint), rows.of_joint(joint))
        for joint in rows.joints
    ]
    remains = sum(own.remains for own in found)
    errors = np.array([own.remains / own.z if own.z > 0 else 0.0 for own in found])
    shares: dict[str, float] = {}
    for own in found:
        for name, share in own.depends_on:
            part = share * own.remains / max(remains, 1e-300)
            shares[name] = max(shares.get(name, 0.0), part)
    return Explainable(
        model_loss=sum(own.model_loss for own in found),
        splines_loss=sum(own.splines_loss for own in found),
        z=remains / max(float(np.sqrt((errors**2).sum())), 1e-300),
        rank_z=max(own.rank_z for own in found),
        depends_on=tuple(
            sorted(((n, s) for n, s in shares.items() if s > TOLD), key=lambda pair: -pair[1])[:3]
        ),
        noise={joint: noise for own in found for joint, noise in own.noise.items()},
    )
