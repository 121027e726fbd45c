"""How texts in requests must be written, and in which words one that is not is refused."""

from collections.abc import Mapping

#: One line without control characters, which PostgreSQL and terminals would stumble over.
PRINTABLE = r"^[^\x00-\x1f\x7f]+$"
#: The same, and no formula: spreadsheets compute what so begins in a table of results, and may run
#: programs for it.
NO_FORMULA = r"^[^\x00-\x1f\x7f=+@-][^\x00-\x1f\x7f]*$"

_WORDS: Mapping[str, str] = {
    NO_FORMULA: "must be one line without control characters that begins with none of = + - @, "
    "which is a formula in spreadsheets",
}
#: How the other patterns begin that refuse control characters.
_NO_CONTROLS = r"^[^\x00-\x"


def wanted(pattern: str) -> str:
    """Say what a text must be that should match a pattern, for who does not read patterns."""
    if pattern in _WORDS:
        return _WORDS[pattern]
    if not pattern.startswith(_NO_CONTROLS):
        return f"must match {pattern}"
    if r"/\\" in pattern:
        return r"must have neither control characters nor / or \ in it"
    return "must have no control characters in it"
