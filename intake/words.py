"""Counts in sentences: one of a thing is no plural."""


def counted(number: int, one: str, many: str) -> str:
    """Return a number with what it counts, as in "1 sample was" and "3 samples were".

    Args:
        number: how many.
        one: what follows 1, with its verb if there is one.
        many: what follows any other number.
    """
    return f"{number} {one if number == 1 else many}"
