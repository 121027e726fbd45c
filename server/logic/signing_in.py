"""How a browser is known: a cookie that says who signed in, sealed with the operator's token.

Of cookies nothing is stored: a coordinator that restarts knows its readers again, and one with
another token knows none. The cookie is no token: it is good for pages of this coordinator only, and
only as long as the token that was shown is.
"""

import hashlib
import hmac
from collections.abc import Mapping

#: Who has the operator's own token, which is in no table.
OPERATOR = "operator"
#: Seconds that a sign-in lasts, and that a code may be used, once.
SIGNED_IN_SECONDS = 7 * 86400.0
CODE_SECONDS = 3600.0
#: Codes of one token that wait to be used; the oldest goes for one too many.
MOST_CODES = 100
#: Requests that change nothing.
READING = ("GET", "HEAD", "OPTIONS")


class Seal:
    """Makes cookies and opens them again.

    Args:
        token: the operator's own.
    """

    def __init__(self, token: str) -> None:
        self._key = hmac.digest(token.encode(), b"rehyb signs in", "sha256")
        #: Browsers do not part cookies by port: two coordinators on a host have two names.
        self.cookie = "rehyb_" + hashlib.sha256(self._key).hexdigest()[:8]

    def close(self, who: str, *, until: float) -> str:
        """Return what a cookie holds: `who` is a token's id, or `OPERATOR`."""
        said = f"{who}.{int(until)}"
        return f"{said}.{self._mark(said)}"

    def open(self, value: str, *, now: float) -> str | None:
        """Return who is named in a cookie; None if it is not ours or too old."""
        said, _, mark = value.rpartition(".")
        who, _, until = said.rpartition(".")
        if not hmac.compare_digest(mark.encode(), self._mark(said).encode()):
            return None
        return who if now < int(until) else None

    def _mark(self, said: str) -> str:
        return hmac.new(self._key, said.encode(), "sha256").hexdigest()


def comes_from_here(headers: Mapping[str, str]) -> bool:
    """Say whether a page of this coordinator made a request, and no other site (CSRF).

    Browsers name the page's origin with whatever may change something, and no page can lie.
    """
    host = headers.get("host")
    return host is not None and headers.get("origin") in (f"http://{host}", f"https://{host}")
