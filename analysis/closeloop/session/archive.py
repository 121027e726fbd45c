"""A session as one zip file: unpacked in a scratch folder, under limits, and never outside it."""

import re
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.files import SESSION_FILE
from intake.xml import listed
from intake.zips import Limits, only_folder, unpack

LIMITS = Limits(
    files=500,
    # What 200 trials of two minutes at 1 kHz take, and room.
    unpacked=2_000_000_000,
    most="a recording takes",
    folder="a session's folder",
)


def opened(path: Path) -> AbstractContextManager[Path]:
    """Return the folder of a session that is one or a zip file, for a `with` block."""
    return nullcontext(path) if path.is_dir() else unpacked(path)


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Yield the session's folder of a zip file; it is gone afterwards.

    Raises:
        SessionError: the file is no zip, holds no session, or would do harm.
    """

    def wrong(detail: str) -> SessionError:
        return SessionError(detail, file=path.name)

    if path.name == SESSION_FILE and path.is_file():
        raise wrong("is a part of a session: name the folder that it is in")
    if path.suffix == ".csv" and path.is_file():
        raise wrong(f"is no session: `rehyb inspect {path.name} --out DIR` writes one of it")
    with tempfile.TemporaryDirectory(prefix="rehyb-session-") as scratch:
        # Reports call a session by its folder's name.
        folder = Path(scratch) / (re.sub(r"[^\w.-]", "_", path.stem).strip(".") or "session")
        folder.mkdir()
        unpack(path, folder, LIMITS, wrong)
        found = only_folder(folder, SESSION_FILE)
        if found is None:
            raise wrong(_elsewhere(folder))
        yield found


def _elsewhere(folder: Path) -> str:
    """Say why a folder that was packed is no session."""
    inner = sorted(
        path.parent.relative_to(folder).as_posix() for path in folder.rglob(SESSION_FILE)
    )
    if not inner:
        return f"holds no {SESSION_FILE}"
    return (
        f"holds {SESSION_FILE} in {listed(inner)}, and has to hold one session alone: its files, "
        "or the one folder that they are in"
    )
