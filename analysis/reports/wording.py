"""How a report writes names and numbers.

Numbers have the digits that their intervals allow: two of the half width at most (JCGM 2008, Guide
to the expression of uncertainty in measurement, section 7.2.6).
"""

from math import floor, log10

#: What to do where nothing is heard of an analysis.
START_ONE = "if none runs, start `rehyb analysis` (or `rehyb up`)"
#: Characters that show as nothing, or turn what stands behind them around: controls but tab and
#: line ends, marks and overrides of direction (Unicode Technical Report 36, section 2.6), spaces
#: of no width, separators. Joiners stay: scripts and pictures are written with them.
_UNSEEN = (
    *(*range(0x09), 0x0B, 0x0C, *range(0x0E, 0x20), *range(0x7F, 0xA0)),
    *(0x061C, 0x180E, 0x200B, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2060, 0x2070)),
    *(0xFEFF, *range(0xFFF9, 0xFFFC), *range(0xE0000, 0xE0080)),
)
_SHOWN = {code: f"\\u{code:04x}" for code in _UNSEEN}


def visible(text: str) -> str:
    """Return a text in which what would not be seen is written out, such as \\u202e."""
    return text.translate(_SHOWN)


def left_by_analysis(count: int) -> str:
    """Return in a sentence that results wait for an analysis; empty if none do."""
    wait = "result waits" if count == 1 else "results wait"
    return f"{count} {wait} for an analysis: {START_ONE}" if count else ""


def words(name: str) -> str:
    """Return a name as a reader would write it."""
    return visible(name).replace("_", " ")


def with_unit(name: str, unit: str) -> str:
    """Return a name as a reader would write it, and its unit if it has one."""
    return f"{words(name)} ({unit})" if unit else words(name)


def with_interval(value: float, low: float | None, high: float | None) -> tuple[str, str]:
    """Return a number and its interval, "[low, high]", as a reader wants them.

    All have as many decimals as two digits of the interval's half width need: more would be noise.
    A number that is not 0 is not rounded to it, and where the interval leaves out 0 each number
    keeps two digits of its own: [0.011, 499] says that the lower bound is small. Without an
    interval, or with one of no width, the number has three digits and the other is "".
    """
    if low is None or high is None:
        return f"{value:.3g}", ""
    half = 0.5 * (high - low)
    if not half > 0.0:
        return f"{value:.3g}", f"[{low:.3g}, {high:.3g}]"
    if half < 1e-4 or half >= 1e5:
        return f"{value:.3g}", f"[{low:.2g}, {high:.2g}]"
    decimals = max(1 - floor(log10(half)), 0)
    digits = 2 if low * high > 0.0 else 1
    said = [_rounded(number, decimals, digits) for number in (value, low, high)]
    return said[0], f"[{said[1]}, {said[2]}]"


def _rounded(number: float, decimals: int, digits: int) -> str:
    """Return a number with so many decimals, or more for its first digits not to be lost."""
    if number == 0.0:
        return f"{0.0:.{decimals}f}"
    needed = digits - 1 - floor(log10(abs(number)))
    return f"{number:.{digits}g}" if needed > 6 else f"{number:.{max(decimals, needed)}f}"
