"""What a number that came as JSON may be (Bray 2017, RFC 8259, section 6)."""

from math import isfinite


def is_finite_number(value: object) -> bool:
    """Say whether a JSON value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return isfinite(value)
    except OverflowError:
        return False
