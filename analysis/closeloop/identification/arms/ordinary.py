"""What every joint of a robot may have, which is asked of it before anything rare."""

from functools import partial

import numpy as np

from analysis.closeloop.identification.arms.agreed import FRICTION
from analysis.closeloop.identification.balance.declared import declared_again, hung_again
from analysis.closeloop.identification.balance.model import Model, unfitted, with_independent
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.nameable import lowest, one_way
from sim.effects.catalogue import BY_NAME

#: What every joint of a robot may have.
ORDINARY = ("torque_offset", *FRICTION, "added_inertia")
#: Of one that moves in one direction only friction is asked, which an offset looks like there.
RESISTING = (*FRICTION, "added_inertia")


def with_ordinary(model: Model, rows: Rows) -> Model:
    """Add what every joint may have, as far as it is not declared or there."""
    recording = model.recording
    there = {
        (name, candidate.joint)
        for candidate in model.effects
        for name in (candidate.effect.name, *candidate.effect.includes)
    }
    for joint in rows.joints:
        for name in RESISTING if _only_resists(rows, joint) else ORDINARY:
            effect = BY_NAME[name]
            if (name, joint) in model.declared | there:
                continue
            here = Candidate(effect=effect, joint=joint)
            # Beside declared friction less is found, too. Inertia that is taken away is what wrong
            # links look like, and in a motion of one frequency a spring.
            free = {"torque_offset": -np.inf, "added_inertia": 0.0}
            lower = (free[name],) if name in free else lowest(model, here)
            choices = [
                with_independent(
                    model,
                    Term(
                        effect=effect,
                        joint=joint,
                        columns=effect.columns(unfitted(recording, joint), theta),
                        lower=lower,
                        theta=theta,
                        candidate=here,
                    ),
                    rows,
                )
                for theta in effect.thetas(unfitted(recording, joint))
            ]
            model = min(choices, key=lambda choice: _misfit(choice, rows, joint))
        # Alone, declared Coulomb friction that turns slowly is viscous friction, too.
        model = declared_again(model, rows, partial(_misfit, rows=rows, joint=joint), of=joint)
    return hung_again(model, rows)


def _only_resists(rows: Rows, joint: int) -> bool:
    """Whether a joint moves in one direction only, and what is left of it is against that."""
    recording, samples = rows.recording, rows.samples[joint]
    left = recording.effort[samples, joint] - recording.filtered(recording.rigid)[samples, joint]
    against = float(left @ np.sign(recording.velocity[samples, joint]))
    return one_way(rows, joint) and against > 0.0


def _misfit(model: Model, rows: Rows, joint: int) -> float:
    """Return what is left of one joint's rows under the model's terms."""
    part = rows.parts[joint]
    base = model.base(rows)[0][part]
    base = base[:, base.any(axis=0)]
    target = model.target(rows)[part]
    return float(((target - base @ np.linalg.lstsq(base, target, rcond=None)[0]) ** 2).sum())
