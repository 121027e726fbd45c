"""How texts in requests must be written, and in which words one that is not is refused."""

from collections.abc import Mapping

#: What PostgreSQL and terminals would stumble over, and what nobody sees or turns the line around:
#: a name with it looks like another one. It begins as patterns do that refuse control characters.
_CONTROLS = r"\x00-\x1f\x7f-\x9f"
_UNSEEN = r"\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
HIDDEN = _CONTROLS + _UNSEEN
#: One line of what is seen.
PRINTABLE = f"^[^{HIDDEN}]+$"
#: The same, and no formula: spreadsheets compute what so begins in a table of results, and may run
#: programs for it.
NO_FORMULA = f"^[^{HIDDEN}=+@-][^{HIDDEN}]*$"
#: What may name a file.
FILE_NAME = rf"^[^{HIDDEN}/\\]+$"

_WORDS: Mapping[str, str] = {
    NO_FORMULA: "must be one line without control characters that begins with none of = + - @, "
    "which is a formula in spreadsheets",
    PRINTABLE: "must have no control characters in it, nor invisible ones, as U+200B and U+202E",
    FILE_NAME: r"must have neither control or invisible characters nor / or \ in it",
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
