"""What a reader has seen already need not be sent again (RFC 9110, section 13)."""

import hashlib
import json


def tag(*parts: object, weak: bool = False) -> str:
    """Return an entity tag that is equal exactly when all `parts` are.

    `parts` are JSON values; `weak`: answers under one tag may differ in what does not matter.
    """
    digest = hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:20]
    return f'W/"{digest}"' if weak else f'"{digest}"'


def is_known(tag: str, if_none_match: str | None) -> bool:
    """Say whether the header If-None-Match names `tag`; weakly, as it is defined to."""
    if if_none_match is None:
        return False
    known = [one.strip().removeprefix("W/") for one in if_none_match.split(",")]
    return "*" in known or tag.removeprefix("W/") in known
