"""Groups of trials that are left out by halves: each alone shows a load, or moves a joint, or two.

Left out whole, nothing would be known of what such a group shows. Halved, each half knows the
other's.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.runs import MOVING

#: A group moves a joint alone if it holds this share of the squares of all groups' ways (of two
#: joints, of the shorter way). Without it what goes by that position has more than three times the
#: error.
ALONE_SHARE = 0.9


def lone_carriers(trials: Sequence[Trial]) -> set[str]:
    """Return the groups of which each alone carries a payload."""
    carriers: dict[str, set[str]] = {}
    for trial in trials:
        if trial.payload is not None:
            carriers.setdefault(trial.payload.name, set()).add(trial.group)
    return {group for groups in carriers.values() if len(groups) == 1 for group in groups}


def lone_movers(travel: Mapping[str, Sequence[np.ndarray]], joints: Sequence[int]) -> set[str]:
    """Return the groups that alone move a joint, or alone two at once.

    Be it one that has no balance: what another one does at it is known from nowhere else.

    Args:
        travel: by group, how far every joint moves in each of its trials, rad or m, (joints,).
        joints: those that have a balance; what holds them all has nothing to be predicted.
    """
    found = {
        group: np.max([np.minimum.outer(own, own) for own in trials], axis=0)
        for group, trials in travel.items()
        if max(own[list(joints)].max() for own in trials) > MOVING
    }
    if len(found) < 2:
        return set()
    ways = np.stack([*found.values()])
    alone = (ways > MOVING) & (ways**2 > ALONE_SHARE * (ways**2).sum(axis=0))
    return {group for group, own in zip(found, alone, strict=True) if own.any()}
