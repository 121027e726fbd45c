"""Which code closes loops here: a report is only as old as that."""

import hashlib
from functools import cache
from pathlib import Path

import sim


@cache
def digest() -> str:
    """Return a digest of the sources that a report depends on, 16 hexadecimal digits."""
    found = hashlib.sha256()
    here, simulation = Path(__file__).parent, Path(str(sim.__file__)).parent
    pages = here.parent / "reports"
    for folder, patterns in (
        (here, ("*.py",)),
        (simulation, ("*.py", "*.xml")),
        (pages, ("html.py", "wording.py", "templates/*")),
    ):
        for path in sorted(path for pattern in patterns for path in folder.rglob(pattern)):
            found.update(path.relative_to(folder).as_posix().encode() + b"\0")
            found.update(path.read_bytes() + b"\0")
    return found.hexdigest()[:16]
