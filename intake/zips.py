"""A zip file unpacked under limits, and never outside the folder that it is given."""

import lzma
import re
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

#: Makes an error of a sentence; the caller knows what the file is called.
Wrong = Callable[[str], Exception]

#: Unpacked over packed; recorded signals reach ten, a bomb a thousand.
MAX_RATIO = 200
#: ... which counts from this size on: a small file of equal lines is no bomb.
RATIO_FROM = 20_000_000
CHUNK = 1 << 20
_MAX_DEPTH, _MAX_PART_BYTES = 8, 200


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a zip file may hold.

    Attributes:
        files: how many at most.
        unpacked: bytes over all of them.
        most: what unpacks to more than is plausible, in words: "a recording takes".
        folder: where its paths stay, in words: "a session's folder".
    """

    files: int
    unpacked: int
    most: str
    folder: str


def unpack(path: Path, folder: Path, limits: Limits, wrong: Wrong) -> None:
    """Unpack the zip file `path` into `folder`, which exists and is empty.

    Raises:
        Exception: what `wrong` makes of a sentence: the file is no zip, is damaged, or would do
            harm.
    """
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError, RuntimeError):
        raise wrong("is neither a folder nor a zip file") from None
    except OSError as error:
        raise wrong(f"cannot be read: {error.strerror}") from None
    with archive:
        # Not `is_dir`, which fails at a member without a name.
        members = [one for one in archive.infolist() if not one.filename.endswith("/")]
        if len(members) > limits.files:
            raise wrong(f"holds {len(members)} files; at most {limits.files}")
        seen: dict[str, str] = {}
        left = limits.unpacked
        for member in members:
            inner = _checked(member, limits, wrong)
            # Some file systems do not tell capitals apart.
            before = seen.setdefault(inner.lower(), inner)
            if before is not inner:
                raise wrong(_twice(before, inner))
            try:
                left -= _write(archive, member, folder / inner, left, limits, wrong)
            except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError):
                raise wrong(f"{inner[:60]!r} in it is damaged") from None
            except (FileExistsError, NotADirectoryError, IsADirectoryError):
                raise wrong(f"{inner[:60]!r} is a file and a folder in it") from None


def _twice(one: str, other: str) -> str:
    if one == other:
        return f"holds {one[:60]!r} twice"
    return (
        f"holds {one[:60]!r} and {other[:60]!r}, which differ in capitals alone: not every file "
        "system tells them apart; rename one"
    )


def only_folder(folder: Path, file: str) -> Path | None:
    """Return where `file` is: at the top, or in the one folder that was packed; None: nowhere."""
    if (folder / file).is_file():
        return folder
    inner = [path for path in folder.iterdir() if path.name != "__MACOSX"]
    if len(inner) == 1 and (inner[0] / file).is_file():
        return inner[0]
    return None


def _write(
    archive: zipfile.ZipFile,
    member: zipfile.ZipInfo,
    target: Path,
    left: int,
    limits: Limits,
    wrong: Wrong,
) -> int:
    """Write a member and return its size.

    Sizes in the archive's index are what its maker says; only bytes that come out count.
    """
    limit = min(left, max(RATIO_FROM, MAX_RATIO * member.compress_size))
    target.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with target.open("xb") as out:
        for chunk in _chunks(archive, member):
            written += len(chunk)
            if written > limit:
                raise wrong(f"unpacks {member.orig_filename[:60]!r} to more than {limits.most}")
            out.write(chunk)
    return written


def _chunks(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[bytes]:
    """Yield what a member unpacks to; BadZipFile if it is damaged."""
    try:
        with archive.open(member) as source:
            while chunk := source.read(CHUNK):
                yield chunk
    except (OSError, OverflowError, ValueError, lzma.LZMAError):
        # It begins where no file has a place, or is not packed as the index says.
        raise zipfile.BadZipFile from None


def _checked(member: zipfile.ZipInfo, limits: Limits, wrong: Wrong) -> str:
    """Return a member's path, which stays inside the folder."""
    # What the archive says, not what zipfile makes of it.
    inner = member.orig_filename
    parts = PurePosixPath(inner).parts
    if (
        not parts
        or inner.startswith("/")
        or ".." in parts
        or re.search(r'[\\:*?"<>|\x00-\x1f]', inner)
        or any(len(part.encode(errors="replace")) > _MAX_PART_BYTES for part in parts)
        or len(parts) > _MAX_DEPTH
    ):
        raise wrong(f"{inner[:60]!r} in it is no path inside {limits.folder}")
    kind = member.external_attr >> 16
    if kind and stat.S_IFMT(kind) not in (0, stat.S_IFREG):
        raise wrong(f"{inner[:60]!r} in it is a link or a device, not a file")
    if member.flag_bits & 0x1:
        raise wrong(f"{inner[:60]!r} in it is encrypted")
    return inner
