"""Grow on beside friction that was found, where what its device sticks in hides the rest.

Friction is fitted as it turns with the velocity. Where a joint turns around it does not do quite
that, and of a limb on a soft cuff four fifths of what Stribeck's law left were there, in a tenth of
the samples: the cuff's spring was not seen, and K was a sixth too low. (An opponent's.)
"""

from collections.abc import Callable

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.sticking import sliding_anyway
from analysis.closeloop.identification.candidates import candidates
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.growing.steps import grow


def grown_slid(
    grown: Grown, declared: Model, rows: Rows, progress: Callable[[str], None]
) -> tuple[Grown, Rows]:
    """Return what is found without the samples in which friction sticks, and the rows it is of.

    The same as before if little of what friction leaves is there, or if no more is found without.

    Args:
        grown: the model with its effects.
        declared: the model without effects.
        rows: the samples that it was fitted to.
        progress: is told what is done.
    """
    rubbing = tuple(step for step in grown.steps if step.taken.candidate.effect.rubs)
    keys = {step.key for step in rubbing}
    plain = grown.model.keeping(lambda candidate: candidate.key in keys)
    slid = sliding_anyway(plain, rows) if rubbing else rows
    if len(slid.weight) == len(rows.weight):
        return grown, rows
    begun = Grown(plain, evaluate(plain, slid), rubbing)
    # Which law its friction has, all samples have shown.
    joints = {step.key[1] for step in rubbing}
    tried = [c for c in candidates(rows.recording) if not (c.effect.rubs and c.joint in joints)]
    again, _ = grow(begun, slid, evaluate(declared, slid), progress, tried)
    if len(again.steps) == len(rubbing) == len(grown.steps):
        return grown, rows
    return again, slid
