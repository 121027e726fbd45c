"""Who may do what: tokens with scopes. Of a secret only its digest is ever kept."""

import hashlib
import re
import secrets
from collections.abc import Collection, Mapping

#: submit: make and control studies. work: lease and post. read: look at everything. admin: all.
SCOPES = ("submit", "work", "read", "admin")
#: Most characters of a token's name.
NAME_LENGTH = 128
#: Bytes of randomness in a secret; nobody guesses these, however fast they may try.
SECRET_BYTES = 24
#: Failures of one address within FAILURE_SECONDS after which its wrong tokens are no longer
#: looked up.
FAILURES = 20
FAILURE_SECONDS = 60.0

#: By secret or id of tokens that were good: until when that is believed, the id and the scopes.
Believed = dict[bytes | str, tuple[float, tuple[str, tuple[str, ...]]]]

#: What whoever works must have.
_OF_WORK = re.compile(r"/v1/sessions/[^/]+/archive|/v1/models(/.*)?|/v1/work")


def is_name(text: str) -> bool:
    """Say whether a token may be called so: in a list it takes one line, and is seen."""
    return 0 < len(text) <= NAME_LENGTH and text.isprintable() and not text.isspace()


def new_secret() -> str:
    """Return a secret to be shown once."""
    return f"rehyb_{secrets.token_urlsafe(SECRET_BYTES)}"


def digest(secret: bytes) -> str:
    """Return what is kept of a secret. It is long and random: no salt, no slow hash is needed."""
    return hashlib.sha256(secret).hexdigest()


def scopes_needed(method: str, path: str) -> tuple[str, ...]:
    """Return the scopes any of which a request to a guarded path needs."""
    if path == "/v1/results" or path == "/v1/leases" or path.startswith("/v1/leases/"):
        return ("work",)
    if path == "/openapi.json":
        # Whoever may do anything may know how.
        return SCOPES
    if path == "/v1/sign-in-codes":
        # What a code is good for: to look at pages.
        return ("read",)
    if method in ("GET", "HEAD", "OPTIONS"):
        return ("read", "work") if _OF_WORK.fullmatch(path) else ("read",)
    if path == "/v1/models":
        # Workers announce what they have.
        return ("submit", "work")
    return ("work",) if path.startswith("/v1/close-loops/") else ("submit",)


def may(scopes: Collection[str], needed: Collection[str]) -> bool:
    """Say whether a token with `scopes` may do what needs any of the scopes `needed`."""
    return "admin" in scopes or any(scope in scopes for scope in needed)


class Failures:
    """Counts wrong tokens by address, over a sliding window."""

    def __init__(self) -> None:
        self._times: dict[str, list[float]] = {}

    def count(self, address: str, now: float) -> None:
        """Note one failure."""
        if len(self._times) > 10_000:
            # Nobody fills the memory by coming from everywhere.
            self._times = {a: t for a, t in self._times.items() if t[-1] > now - FAILURE_SECONDS}
        recent = [time for time in self._times.get(address, ()) if time > now - FAILURE_SECONDS]
        self._times[address] = [*recent[-FAILURES:], now]

    def too_many(self, address: str, now: float) -> bool:
        """Say whether an address has used up its patience."""
        times: Mapping[str, list[float]] = self._times
        recent = [time for time in times.get(address, ()) if time > now - FAILURE_SECONDS]
        return len(recent) >= FAILURES
