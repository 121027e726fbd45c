"""Close the loop through a coordinator: pack a session, follow a worker, fetch what it found."""

import json
import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from errno import ENOTDIR
from pathlib import Path
from typing import Any

from rehyb.client import Client
from rehyb.client.sessions import FILES
from rehyb.errors import Invalid, RehybError

#: What an archive may not have in its names, and a coordinator not in a session's.
_ODD = re.compile(r'[\\/:*?"<>|\x00-\x1f\x7f]')


def close_loop(
    client: Client, session: Path, out: Path, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Have a worker close the loop on a session and write the report's files to `out`.

    The same session again finds the report that is there already.

    Args:
        client: the coordinator.
        session: a folder with session.json, or its zip file.
        out: a folder; nothing is there unless the report is.
        progress: is told in a line what is done now.

    Returns:
        The content of report.json.

    Raises:
        Invalid: the session cannot be analysed; the message names file, column and line.
        RehybError: the coordinator does not answer, or no worker came to an end with it.
        OSError: `out` cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(ENOTDIR, "is a file, not a folder for the report", str(out))
    progress("uploading")
    with packed(session) as archive:
        kept = client.upload_session(archive, _ODD.sub("_", session.resolve().stem)[:60])
    job = client.close_loop(kept["id"])
    told = [""]

    def follow(standing: dict[str, Any]) -> None:
        stage = standing.get("note") or standing["progress"] or standing["state"]
        if stage != told[-1]:
            told.append(stage)
            progress(stage)

    ended = client.wait_for_report(job["id"], on_progress=follow)
    if ended["state"] == "failed":
        problem = ended["problem"]
        kind = Invalid if problem["status"] == 422 else RehybError
        raise kind(problem["detail"], problem)
    return _fetched(client, job["id"], out)


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
                    _add(file, path, folder, f"{_ODD.sub('_', folder.name)}/{inner.as_posix()}")
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


def _fetched(client: Client, close_loop_id: str, out: Path) -> dict[str, Any]:
    """Write a report's files to `out`, all or none, and return the report."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".close-loop-") as scratch:
        fresh = Path(scratch)
        for name in FILES:
            client.close_loop_file(close_loop_id, name, fresh / name)
        report: dict[str, Any] = json.loads((fresh / "report.json").read_text(encoding="utf-8"))
        out.mkdir(exist_ok=True)
        for name in FILES:
            shutil.move(str(fresh / name), str(out / name))
    return report
