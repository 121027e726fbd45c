"""Places and forces of a tool, which look like those of joints called x, y and z."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from analysis.closeloop.logs.belief import CHAIN, OF_A_TOOL, POSES, WORDS, Belief, words_of

AXES = ("x", "y", "z")
#: Of both of which a wrench has one along, or about, each axis.
FORCES, TORQUES = {"force", "forces"}, {"torque", "torques", "moment", "moments"}


def without_tools(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return beliefs in which a pose and a wrench are a tool's.

    A gantry has joints x, y and z, too. But it has no orientation beside them, nor both a force and
    a torque of each.
    """
    poses = {_before(belief) for belief in beliefs if _has(belief, {*POSES})}
    said: dict[str, set[bool]] = defaultdict(set)
    for belief in beliefs:
        if belief.quantity == "effort" and (_has(belief, FORCES) or _has(belief, TORQUES)):
            said[belief.stem].add(_has(belief, FORCES))
    found = []
    for belief in beliefs:
        along = belief.stem.rpartition("_")[2] in AXES
        in_pose = belief.quantity in CHAIN and _before(belief) in poses
        in_wrench = belief.quantity == "effort" and len(said[belief.stem]) > 1
        if along and (in_pose or in_wrench):
            belief = replace(belief, quantity="unknown", stem="", why=OF_A_TOOL)
        found.append(belief)
    return found


def _has(belief: Belief, words: set[str]) -> bool:
    return bool({*words_of(belief.channel.name)} & words)


def _before(belief: Belief) -> tuple[str, ...]:
    """Return the words of a name before that for a quantity or a pose."""
    words = words_of(belief.channel.name)
    own = {*POSES, *WORDS.get(belief.quantity, ())}
    return tuple(words[: next((at for at, word in enumerate(words) if word in own), len(words))])
