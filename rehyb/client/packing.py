"""A session's folder as the zip file that a coordinator takes."""

import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rehyb.errors import Invalid

#: What an archive may not have in its names, and a coordinator not in a session's.
_FORBIDDEN = re.compile(r'[\\/:*?"<>|\x00-\x1f\x7f]')


def plain_name(name: str) -> str:
    """Return a folder's name as an archive, and a coordinator, may have it."""
    return _FORBIDDEN.sub("_", name)


@contextmanager
def packed(session: Path) -> Iterator[Path]:
    """Yield a session as a zip file: itself if it is one, else a packed copy of the folder.

    Equal folders make equal files, so that a coordinator knows them again. Hidden files stay out;
    a link out of the folder stays a link, which the coordinator refuses.

    Raises:
        Invalid: there is no such file or folder.
    """
    if session.is_file():
        yield session
        return
    if not session.is_dir():
        raise Invalid(f"{session}: there is no such folder; name one with a session.json")
    folder = session.resolve()
    with tempfile.TemporaryDirectory(prefix="rehyb-pack-") as scratch:
        archive = Path(scratch) / "session.zip"
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
            for path in sorted(folder.rglob("*")):
                inner = path.relative_to(folder)
                if not any(part.startswith(".") for part in inner.parts):
                    _add(file, path, folder, f"{plain_name(folder.name)}/{inner.as_posix()}")
        yield archive


def _add(file: zipfile.ZipFile, path: Path, folder: Path, name: str) -> None:
    member = zipfile.ZipInfo(name)
    member.compress_type = zipfile.ZIP_DEFLATED
    if path.is_symlink() and not path.resolve().is_relative_to(folder):
        member.external_attr = (stat.S_IFLNK | 0o777) << 16
        file.writestr(member, str(path.readlink()))
    elif path.is_file():
        member.external_attr = (stat.S_IFREG | 0o644) << 16
        with path.open("rb") as source, file.open(member, "w", force_zip64=True) as target:
            shutil.copyfileobj(source, target, 1 << 20)
