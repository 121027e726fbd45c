"""What cuffs and straps do to skin and tissue in an assessment, as clinicians look at it."""

import numpy as np

from sim.interface.interface import Loads

#: A peak of pressure or shear is borne for so long, s: where an element slips off the edge of a
#: cuff, its force jumps for a step or two.
SUSTAINED = 0.1
LIMBS = ("upper_arm", "forearm")


def on_skin(loads: Loads, step: float) -> dict[str, float]:
    """Return pressure and shear under each limb's cuff and strap, kPa, and its tissue's strain.

    Peaks are the most that an element bears for SUSTAINED together; means are over the skin that is
    touched and over the movement.

    Args:
        loads: of a movement in contact, SUSTAINED long or longer.
        step: between two of its rows, s.
    """
    outputs, window = {}, round(SUSTAINED / step)
    for limb, name in enumerate(LIMBS):
        for quantity in ("pressure", "shear"):
            peak, mean = getattr(loads, f"peak_{quantity}"), getattr(loads, f"mean_{quantity}")
            borne = np.lib.stride_tricks.sliding_window_view(peak[:, limb], window).min(axis=1)
            outputs[f"peak_{quantity}_{name}"] = 1e-3 * float(borne.max())
            outputs[f"mean_{quantity}_{name}"] = 1e-3 * float(mean[:, limb].mean())
        outputs[f"tissue_strain_{name}"] = float(loads.strain[:, limb].max())
    return outputs
