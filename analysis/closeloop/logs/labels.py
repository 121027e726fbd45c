"""Lines that say before each number what it is, as programs print to a serial port."""

import re
from collections import Counter
from collections.abc import Sequence

#: A label and its number, `Position: 594` or `q1=0.3`, and what stands before the next.
PAIR = re.compile(
    r"\s*(?P<label>[^:=,;|\t]+?)\s*[:=]\s*"
    r"(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan)(?=[\s,;|]|$)[\s,;|]*",
    re.IGNORECASE,
)
#: Lines from the middle of a file by which it is told, and the share of them that are alike. (Of a
#: servo's three logs, which it was looked at on, all but five are.)
LINES, MOSTLY = 50, 0.9


def without_labels(lines: Sequence[str]) -> tuple[list[str], int]:
    """Return lines with the labels in a header above them, and how many others were left out.

    The lines as they are, and none, if most do not have the same labels, two or more. The first
    and the last of what is caught from a port may be cut.
    """
    start = max(0, (len(lines) - LINES) // 2)
    middle = Counter(_parted(line)[0] for line in lines[start : start + LINES])
    labels, count = middle.most_common(1)[0]
    if len(labels) < 2 or count < MOSTLY * middle.total():
        return [*lines], 0
    parted = map(_parted, lines)
    rows = [",".join(numbers) for own, numbers in parted if own == labels]
    return [",".join(labels), *rows], len(lines) - len(rows)


def _parted(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the labels and the numbers of a line; none if it holds anything else."""
    labels, numbers, at = [], [], 0
    while at < len(line):
        pair = PAIR.match(line, at)
        if pair is None or not any(mark.isalpha() for mark in pair["label"]):
            return (), ()
        labels.append(pair["label"])
        numbers.append(pair["number"])
        at = pair.end()
    return tuple(labels), tuple(numbers)
