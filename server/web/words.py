"""How pages write times, counts and durations."""

from collections.abc import Callable
from datetime import UTC, datetime

from markupsafe import Markup

from analysis.reports.wording import words

_UNITS = (("d", 86400), ("h", 3600), ("min", 60), ("s", 1))


def duration(seconds: float | None) -> str:
    """Return a duration in its two largest units; a dash if it is not known."""
    if seconds is None:
        return "–"
    if seconds < 1.0:
        return "0 s" if seconds < 0.05 else f"{seconds:.1f} s"
    left = round(seconds)
    sizes = iter(_UNITS)
    unit, size = next((unit, size) for unit, size in sizes if left >= size)
    said = f"{left // size} {unit}"
    below = next(sizes, None)
    if below is not None and (rest := left % size // below[1]):
        said += f" {rest} {below[0]}"
    return said


def moment(seconds: float | None) -> Markup | str:
    """Return a time (UTC epoch) that the reader's browser shows in its own zone."""
    if seconds is None:
        return "–"
    at = datetime.fromtimestamp(seconds, UTC)
    return Markup('<time datetime="{}">{} UTC</time>').format(
        at.isoformat(timespec="seconds"), at.strftime("%Y-%m-%d %H:%M")
    )


def count(number: float | None) -> str:
    """Return a number of things with its thousands apart."""
    return "–" if number is None else f"{number:,.0f}"


def rate(per_second: float) -> str:
    """Return a rate in the unit in which it is a readable number."""
    for unit, seconds in (("s", 1.0), ("min", 60.0), ("h", 3600.0)):
        if per_second * seconds >= 1.0 or unit == "h":
            return f"{per_second * seconds:.3g} / {unit}" if per_second else "–"
    raise AssertionError


def percent(share: float | None) -> str:
    """Return a share; one that is not nothing never reads as 0 %."""
    if share is None:
        return "–"
    if 0.0 < share < 0.001:
        return "< 0.1 %"
    return f"{100 * share:.3g} %"


def pair(name: str) -> tuple[str, str]:
    """Return a choice whose value is its name."""
    return name, name


def label(name: str) -> tuple[str, str]:
    """Return a choice that reads as its name in words."""
    return name, words(name)


FILTERS: dict[str, Callable[..., object]] = {
    "duration": duration,
    "moment": moment,
    "count": count,
    "rate": rate,
    "percent": percent,
    "pair": pair,
    "label": label,
}
