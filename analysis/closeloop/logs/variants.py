"""Signals that a log has more than once: in several forms, or from a sensor that feels nothing."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from analysis.closeloop.logs.belief import BY_NAME, SIGNALS, Belief
from intake.xml import listed

#: Words for what was made of a signal; of its forms the rawest is taken, for the delay of a filter
#: that another signal has not passed is no effect of the robot.
RAW = ("raw", "unfiltered", "orig", "original")
MADE = (
    *("filt", "filtered", "filter", "lp", "lowpass", "smooth", "smoothed", "ds", "downsampled"),
    *("resampled", "interp", "interpolated", "denoised", "clean", "cleaned"),
)
#: Correlation of two forms of one signal, at least.
ALIKE = 0.9
#: Share of what a joint's channel is beside another's at the other joints, below which it feels
#: nothing. (Set while looking at the Kinova that it mends, whose last joint has 0.005.)
DEAD, FEWEST = 0.02, 3
#: Root mean square, over the range, of the difference of two positions of which one is wanted of
#: the other's joint; set beside a UR5's log that has none of their names, with 0.004.
FOLLOWS = 0.02
#: Motion of a joint that has to be felt, rad or m.
MOVES = 0.1
#: How the reasons begin.
FORM, FEELS_NOTHING = "another form of ", "feels nothing where "


def without_forms(beliefs: list[Belief]) -> None:
    """Take one form of each signal that a log has raw and filtered, in place."""
    forms: dict[tuple[str, str], list[int]] = {}
    for at, belief in enumerate(beliefs):
        if belief.quantity in (*SIGNALS, "current") and not belief.wanted:
            forms.setdefault((belief.quantity, _parted(belief.stem)[0]), []).append(at)
    several = False
    for group in forms.values():
        first = min(group, key=lambda at: _rank(_parted(beliefs[at].stem)[1]))
        for at in group:
            same = _parted(beliefs[at].stem)[1] == _parted(beliefs[first].stem)[1]
            if at == first or same or not _alike(beliefs[first], beliefs[at]):
                continue
            several = True
            why = f"{FORM}{beliefs[first].channel.name}"
            beliefs[at] = replace(beliefs[at], quantity="unknown", stem="", why=why)
    if several:
        for at, belief in enumerate(beliefs):
            beliefs[at] = replace(belief, stem=_parted(belief.stem)[0])


def _parted(stem: str) -> tuple[str, tuple[str, ...]]:
    """Return a stem without words for forms, and these."""
    words = stem.split("_")
    rest = [word for word in words if word not in RAW and word not in MADE]
    return "_".join(rest), tuple(word for word in words if word not in rest)


def _rank(form: Sequence[str]) -> int:
    """Return how much was made of a signal."""
    return 0 if any(word in RAW for word in form) else 1 + bool(form)


def _alike(one: Belief, other: Belief) -> bool:
    """Whether signals of one length go together; of others their names decide."""
    a, b = one.channel.values, other.channel.values
    if len(a) != len(b):
        return True
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2 or not np.ptp(a[both]) or not np.ptp(b[both]):
        return np.array_equal(a[both], b[both])
    return bool(np.corrcoef(a[both], b[both])[0, 1] > ALIKE)


def without_dead(beliefs: list[Belief]) -> None:
    """Of two sets of efforts take the one that feels every joint that moves, in place."""
    families: dict[str, dict[int, int]] = {}
    for at, belief in enumerate(beliefs):
        if belief.quantity == "effort" and not belief.wanted and belief.joint is not None:
            called = re.sub(r"\d+", "", belief.channel.name)
            families.setdefault(called, {}).setdefault(belief.joint, at)
    positions = {b.joint: b for b in beliefs if b.quantity == "position" and not b.wanted}
    moving = [n for n, b in positions.items() if n is not None and _range(b) > MOVES]
    for name, family in families.items():
        for other, rival in families.items():
            dead = _dead(beliefs, family, rival, moving) if other != name else None
            if dead is None or _dead(beliefs, rival, family, moving) is not None:
                continue
            moved, felt = positions[dead].channel.name, beliefs[rival[dead]].channel.name
            why = f"{FEELS_NOTHING}{moved} moves, beside {felt}"
            for at in family.values():
                beliefs[at] = replace(beliefs[at], quantity="unknown", joint=None, why=why)
            return


def _dead(
    beliefs: Sequence[Belief], own: Mapping[int, int], other: Mapping[int, int], moving: list[int]
) -> int | None:
    """Return a moving joint that a set of efforts does not feel, and another does; None if none.

    Sets in other units differ by as much at every joint.
    """
    joints = [joint for joint in moving if joint in own and joint in other]
    if len(joints) < FEWEST or own.keys() != other.keys():
        return None
    shares = [_range(beliefs[own[n]]) / max(_range(beliefs[other[n]]), 1e-300) for n in joints]
    least = int(np.argmin(shares))
    return joints[least] if shares[least] < DEAD * float(np.median(shares)) else None


def of_followed(beliefs: Sequence[Belief]) -> list[str]:
    """Say which positions without a name go as those of another joint do: one may be wanted.

    Their numbers cannot tell which.
    """
    said = []
    own = [b for b in beliefs if b.quantity == "position" and not b.wanted and b.why != BY_NAME]
    for one, other in combinations([b for b in own if _range(b) > MOVES], 2):
        if one.joint == other.joint or len(one.channel.values) != len(other.channel.values):
            continue
        apart = one.channel.values - other.channel.values
        apart = apart[np.isfinite(apart)]
        if len(apart) and np.sqrt(np.mean(apart**2)) < FOLLOWS * _range(one):
            a, b = one.channel.name, other.channel.name
            said.append(
                f"{b} goes as {a} does: if one of them is what was wanted of the other's joint, "
                f"leave it and its derivatives out, as by --as '{b}=-'"
            )
    return said


def _range(belief: Belief) -> float:
    values = belief.channel.values[np.isfinite(belief.channel.values)]
    return float(np.ptp(values)) if len(values) else 0.0


def of_variants(beliefs: Sequence[Belief]) -> list[str]:
    """Say which signals were left out because the log has others for them."""
    said = []
    for begin, what in (
        (FORM, "other forms of what is taken"),
        (FEELS_NOTHING, "another set of efforts feels every joint"),
    ):
        own = [belief for belief in beliefs if belief.why.startswith(begin)]
        if own:
            names = dict.fromkeys(re.sub(r"\[?\d+\]?$", "", b.channel.name) for b in own)
            example = f"{own[-1].channel.name} {'is ' if begin == FORM else ''}{own[-1].why}"
            said.append(f"left out: {listed(names)} ({what}: {example})")
    return said
