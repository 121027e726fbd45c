"""What is printed where not every character can be."""

import sys
from io import TextIOWrapper


def print_any_character() -> None:
    """Have standard output escape what its encoding lacks, such as μ in a C locale, and not fail.

    Standard error does so by itself.
    """
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def takes_any_character() -> bool:
    """Say whether standard output can bear every character."""
    return (sys.stdout.encoding or "").lower().replace("-", "").startswith("utf")
