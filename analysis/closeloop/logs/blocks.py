"""What stands where in a log without words: blocks of columns, joint by joint.

Such logs hold all positions, then all velocities, then torques or currents, with accelerations
before or after these: the distance between a position and its velocity is the number of joints.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.logs.belief import BY_NAME, BY_UNIT, Belief
from analysis.closeloop.logs.derivatives import slopes_beside

#: Median correlation, over the joints, of a block with the slopes of velocities: of accelerations
#: at least, by so much more than any other block's, and of one that could be either. An iiwa's
#: accelerations, filtered at 25 Hz, have 0.87, and its torques 0.01. (All of these, and those
#: below, were set while looking at that one log.)
ALIKE, CLEARLY, EITHER = 0.5, 0.3, 0.3
#: Accelerations are one share, of a filter, of the slopes at all joints; torques are an inertia's,
#: which is another at each joint: least and most of it, the most over the least, and the fewest
#: joints of which this is told.
SHARE, SPREAD, FEWEST = (0.2, 1.15), 2.0, 3
#: Why a column is neither.
UNDECIDED = "a torque or an acceleration, and numbers do not tell which"


def find_blocks(beliefs: list[Belief]) -> None:
    """Read joints that hardly move, accelerations and efforts off the layout, in place."""
    if any(b.why in (BY_NAME, BY_UNIT) for b in beliefs):
        return
    position = [at for at, b in enumerate(beliefs) if b.quantity == "position"]
    velocity = [at for at, b in enumerate(beliefs) if b.quantity == "velocity"]
    distances = {at - (beliefs[at].source or 0) for at in velocity}
    if len(position) != len(velocity) or len(distances) != 1 or (joints := distances.pop()) < 1:
        return
    clocks = [at for at, b in enumerate(beliefs) if b.quantity == "time" and at < position[0]]
    start = clocks[-1] + 1 if clocks else 0
    if position[-1] - start >= joints:
        start = position[0]
    after = start + 2 * joints
    found = {at - (b.source or 0) for at, b in enumerate(beliefs) if b.quantity == "acceleration"}
    if found and (len(found) > 1 or found - {joints, 2 * joints}):
        return
    _name(beliefs, "position", start, joints, beliefs[position[0]].unit)
    _name(beliefs, "velocity", start + joints, joints, beliefs[velocity[0]].unit)
    # A block after the velocities, 0 or 1, that holds accelerations.
    own = found.pop() // joints - 1 if found else None
    if own is None:
        blocks = [after, after + joints]
        if not all(_is_free(beliefs, block, joints) for block in blocks):
            blocks = []
        own, unsure = _accelerations(beliefs, start + joints, blocks, joints)
        if unsure:
            for at in range(after, after + 2 * joints):
                beliefs[at] = replace(beliefs[at], why=UNDECIDED)
            return
    if own is not None:
        _name(beliefs, "acceleration", after + own * joints, joints, "?")
    _name(beliefs, "effort", after + (joints if own == 0 else 0), joints, "?")


def of_either(beliefs: Sequence[Belief]) -> list[str]:
    """Say of columns that may be torques or accelerations how to name them."""
    names = [belief.channel.name for belief in beliefs if belief.why == UNDECIDED]
    if not names:
        return []
    first, second = names[0], names[len(names) // 2]
    return [
        f"{first} and those after it, or {second} and those after it, are the torques, and the "
        "others may be accelerations: numbers do not tell which, and neither is taken; say "
        f"--as '{first}=JOINT.effort' or --as '{second}=JOINT.effort', and so on for each joint"
    ]


def _is_free(beliefs: Sequence[Belief], start: int, joints: int) -> bool:
    """Whether a whole block of columns stands there of which nothing is known."""
    block = beliefs[start : start + joints]
    return len(block) == joints and all(b.quantity == "unknown" and not b.why for b in block)


def _accelerations(
    beliefs: Sequence[Belief], velocity: int, blocks: Sequence[int], joints: int
) -> tuple[int | None, bool]:
    """Return which block holds accelerations, None if none does, and whether that is unsure.

    Args:
        velocity: place of the first velocity.
        blocks: places of the first columns of blocks.
    """
    alike, factors = [], []
    for block in blocks:
        pairs = [
            slopes_beside(beliefs[velocity + n].channel, beliefs[block + n].channel)
            for n in range(joints)
        ]
        alike.append(float(np.median([pair[0] for pair in pairs])))
        factors.append([pair[1] for pair in pairs if pair[0] >= EITHER])
    if not alike or max(alike) < EITHER:
        return None, False
    best = int(np.argmax(alike))
    clear = alike[best] >= ALIKE and alike[best] - sorted(alike)[-2] >= CLEARLY
    low, high = min(factors[best]), max(factors[best])
    same = SHARE[0] <= low and high <= SHARE[1] and high <= SPREAD * low
    if clear and same and len(factors[best]) >= FEWEST:
        return best, False
    return None, True


def _name(beliefs: list[Belief], quantity: str, start: int, joints: int, unit: str) -> None:
    """Give a quantity to the columns of a block that have none, in place."""
    what = "torque or current" if quantity == "effort" else quantity
    for at in range(start, min(start + joints, len(beliefs))):
        if beliefs[at].quantity in ("unknown", "constant"):
            why = f"stands where the {what} of joint {at - start + 1} should"
            beliefs[at] = replace(beliefs[at], quantity=quantity, unit=unit, why=why)
