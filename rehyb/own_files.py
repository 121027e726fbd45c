"""Which files a command writes over: those that it wrote before, and no other."""

import json
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rehyb.errors import Invalid

#: Bytes in which a page or a table says what it is.
_HEAD, _LONG_HEAD = 4096, 1 << 20


def _head(path: Path, size: int = _HEAD) -> bytes:
    with path.open("rb") as file:
        return file.read(size)


def _is_page(path: Path) -> bool:
    return b'<meta name="generator" content="rehyb">' in _head(path)


def _is_csv(path: Path) -> bool:
    return _head(path).startswith(b"row,position,")


def _is_parquet(path: Path) -> bool:
    # Its metadata are at its end.
    content = path.read_bytes()
    return content.startswith(b"PAR1") and b"rehyb.study" in content[-_LONG_HEAD:]


def _is_netcdf(path: Path) -> bool:
    head = _head(path, _LONG_HEAD)
    return head.startswith(b"CDF") and b'"sampling": ' in head


def _is_bundle(path: Path) -> bool:
    return _members(path) >= {"manifest.json", "study.json", "results.csv"}


def _is_bank(path: Path) -> bool:
    return _members(path) >= {"meta.npy", "bushing.rows.npy"}


def _is_report(path: Path) -> bool:
    content = _json(path)
    return isinstance(content, dict) and {"verdict", "effects"} <= content.keys()


def _is_instance(path: Path) -> bool:
    content = _json(path)
    return isinstance(content, dict) and {"study", "row", "position"} <= content.keys()


def _is_picture(path: Path) -> bool:
    # What drew it says so in each of its formats.
    return b"atplotlib" in path.read_bytes()


def _is_film(path: Path) -> bool:
    head = _head(path)
    return head.startswith(b"GIF8") or head[4:8] == b"ftyp"


def _is_record(path: Path) -> bool:
    return _members(path) >= {"time.npy", "passive_torque.npy", "muscle_torque.npy"}


def _members(path: Path) -> set[str]:
    try:
        with zipfile.ZipFile(path) as archive:
            return set(archive.namelist())
    # The second is of archives that need a later zip than Python reads.
    except (zipfile.BadZipFile, NotImplementedError):
        return set()


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None


#: By what a command writes, what tells that a file is one.
_IS: Mapping[str, Callable[[Path], bool]] = {
    "page": _is_page,
    "csv": _is_csv,
    "parquet": _is_parquet,
    "netcdf": _is_netcdf,
    "bundle": _is_bundle,
    "bank": _is_bank,
    "report": _is_report,
    "instance": _is_instance,
    "picture": _is_picture,
    "film": _is_film,
    "record": _is_record,
    # What is there to be changed by hand is nobody's but the hand's.
    "draft": lambda _: False,
    # Beside no file by which it would be known.
    "other": lambda _: False,
}


def is_own(path: Path, kind: str) -> bool:
    """Say whether there is a file at `path` that a command wrote which writes this `kind`."""
    return path.is_file() and _IS[kind](path)


def check_own(path: Path, kind: str) -> None:
    """Check that writing to `path` replaces nothing but what the same command wrote.

    Args:
        path: of a file to be written.
        kind: a key of `_IS`.

    Raises:
        Invalid: there is another file.
        OSError: it cannot be read.
    """
    # To what is no regular file, whoever writes says so.
    if path.is_file() and not is_own(path, kind):
        why = "not as this command writes it"
        if kind == "draft":
            why = "may have been changed by hand, so it is never written over"
        raise Invalid(f"{path} is there already, and {why}: name another file, or remove it")


def check_own_files(folder: Path, names: Iterable[str], *, by: str, kind: str) -> None:
    """Check that writing `names` to a folder replaces nothing but what the same command wrote.

    Args:
        folder: that is there, or will be.
        names: of files to be written.
        by: name of the file by which the others are known, if it is of this `kind`.
        kind: as of `check_own`.

    Raises:
        Invalid: there is another file, or the folder is a session's.
    """
    if (folder / "session.json").exists():
        raise Invalid(f"{folder} is the folder of a session: name another for what is written")
    if is_own(folder / by, kind):
        return
    for name in names:
        check_own(folder / name, kind if kind == "draft" else "other")
