"""A session as one zip file: unpacked in a scratch folder, under limits, and never outside it."""

import re
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.files import SESSION_FILE

MAX_FILES = 500
#: Unpacked, over all files: what 200 trials of two minutes at 1 kHz take, and room.
MAX_UNPACKED = 2_000_000_000
#: Unpacked over packed; recorded signals reach ten, a bomb a thousand.
MAX_RATIO = 200
#: ... which counts from this size on: a small file of equal lines is no bomb.
RATIO_FROM = 20_000_000
CHUNK = 1 << 20


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Yield the session's folder of a zip file; it is gone afterwards.

    Raises:
        SessionError: the file is no zip, holds no session, or would do harm.
    """
    name = path.name
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        raise SessionError("is neither a folder nor a zip file", file=name) from None
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror}", file=name) from None
    with archive, tempfile.TemporaryDirectory(prefix="rehyb-session-") as scratch:
        # Reports call a session by its folder's name.
        folder = Path(scratch) / (re.sub(r"[^\w.-]", "_", path.stem).strip(".") or "session")
        folder.mkdir()
        _unpack(archive, folder, name)
        yield _session_folder(folder, name)


def _unpack(archive: zipfile.ZipFile, folder: Path, name: str) -> None:
    members = [member for member in archive.infolist() if not member.is_dir()]
    if len(members) > MAX_FILES:
        raise SessionError(f"holds {len(members)} files; at most {MAX_FILES}", file=name)
    seen: set[str] = set()
    left = MAX_UNPACKED
    for member in members:
        inner = _checked(member, name)
        # Some file systems do not tell capitals apart.
        if inner.lower() in seen:
            raise SessionError(f"holds {inner[:60]!r} twice", file=name)
        seen.add(inner.lower())
        limit = max(RATIO_FROM, MAX_RATIO * member.compress_size)
        target = folder / inner
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            # Sizes in the archive's index are what its maker says; only bytes that come out count.
            with archive.open(member) as source, target.open("xb") as out:
                written = 0
                while chunk := source.read(CHUNK):
                    written += len(chunk)
                    left -= len(chunk)
                    if written > limit or left < 0:
                        raise SessionError(
                            f"unpacks {inner[:60]!r} to more than a recording takes", file=name
                        )
                    out.write(chunk)
        except (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError):
            raise SessionError(f"{inner[:60]!r} in it is damaged", file=name) from None
        except (FileExistsError, NotADirectoryError, IsADirectoryError):
            raise SessionError(f"{inner[:60]!r} is a file and a folder in it", file=name) from None


def _checked(member: zipfile.ZipInfo, name: str) -> str:
    """Return a member's path, which stays inside the folder."""
    # What the archive says, not what zipfile makes of it.
    inner = member.orig_filename
    parts = PurePosixPath(inner).parts
    if (
        not parts
        or inner.startswith("/")
        or ".." in parts
        or re.search(r'[\\:*?"<>|\x00-\x1f]', inner)
        or any(len(part.encode(errors="replace")) > 200 for part in parts)
        or len(parts) > 8
    ):
        raise SessionError(f"{inner[:60]!r} in it is no path inside a session's folder", file=name)
    kind = member.external_attr >> 16
    if kind and stat.S_IFMT(kind) not in (0, stat.S_IFREG):
        raise SessionError(f"{inner[:60]!r} in it is a link or a device, not a file", file=name)
    if member.flag_bits & 0x1:
        raise SessionError(f"{inner[:60]!r} in it is encrypted", file=name)
    return inner


def _session_folder(folder: Path, name: str) -> Path:
    """Return where session.json is: at the top, or in the one folder that was packed."""
    if (folder / SESSION_FILE).is_file():
        return folder
    inner = [path for path in folder.iterdir() if path.name != "__MACOSX"]
    if len(inner) == 1 and (inner[0] / SESSION_FILE).is_file():
        return inner[0]
    raise SessionError(f"holds no {SESSION_FILE}", file=name)
