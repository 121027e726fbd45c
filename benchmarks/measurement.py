"""The pages of docs/measurements: what a command printed, on which machine, of which code.

`python -m benchmarks.measurement [NAME ...]` runs the commands of these pages and writes what they
print into docs/measurements/NAME.md; without a name it says which pages are older than the code
that they measure. A page keeps its text: the run replaces its header and what stands between the
marks around the figures.
"""

import hashlib
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from benchmarks.machine import machine

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "measurements"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"
#: Kinds of files that decide what a command prints.
SOURCES = (".py", ".xml", ".js")
#: Stands for what is not known of figures that were copied by hand.
UNKNOWN = "unknown"


class MeasurementError(Exception):
    """A page without a header or marks, or a command that failed."""


@dataclass(frozen=True, kw_only=True)
class Header:
    """What a reader must know of figures; in a page, one item of a list for each field."""

    #: Processor, cores, platform, Python and MuJoCo.
    machine: str
    #: Day on which it was measured, as 2026-11-21.
    date: str
    #: What prints the figures, typed in the repository's root.
    command: str
    #: Git's short name of the code; with "and changes" if files had not been committed.
    commit: str
    #: Folders and files of the code that is measured, in the repository.
    measures: tuple[str, ...]
    #: Digest of these (`digest`).
    sources: str
    #: "by the command", or that somebody copied the figures.
    written: str

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the header of a page.

        Raises:
            MeasurementError: an item is missing.
        """
        found = dict(re.findall(r"^- (\w+): (.+)$", text.split(BEGIN)[0], re.MULTILINE))
        names = [one.name for one in fields(cls)]
        missing = [name for name in names if name.capitalize() not in found]
        if missing:
            raise MeasurementError(f"the header lacks {', '.join(missing)}")
        values = {name: found[name.capitalize()] for name in names}
        return cls(
            **{
                **values,
                "command": values["command"].strip("`"),
                "measures": tuple(re.findall(r"`([^`]+)`", values["measures"])),
            }
        )

    def lines(self) -> list[str]:
        """Return it as the items of a list in Markdown."""
        return [
            f"- Machine: {self.machine}",
            f"- Date: {self.date}",
            f"- Command: `{self.command}`",
            f"- Commit: {self.commit}",
            f"- Measures: {', '.join(f'`{name}`' for name in self.measures)}",
            f"- Sources: {self.sources}",
            f"- Written: {self.written}",
        ]


def digest(measures: Sequence[str], root: Path = ROOT) -> str:
    """Return 16 hexadecimal digits that change with any source of these folders and files.

    It is of the files themselves, so that it can be compared where there is no history of git.
    """
    total = hashlib.sha256()
    for path in sorted({one for name in measures for one in _sources(root / name)}):
        total.update(f"{path.relative_to(root).as_posix()}\0".encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


def _sources(place: Path) -> list[Path]:
    found = [place] if place.is_file() else sorted(place.rglob("*"))
    return [path for path in found if path.suffix in SOURCES]


def age(header: Header, root: Path = ROOT) -> str:
    """Say whether figures are of the code that is here now."""
    if header.sources == UNKNOWN:
        return f"{header.date}, copied by hand: may be older than the code"
    if header.sources != digest(header.measures, root):
        return f"{header.date}, older than {', '.join(header.measures)}"
    return f"{header.date}, of the code as it is"


def rewritten(text: str, header: Header, figures: str) -> str:
    """Return a page with another header and other figures, and its text as it was.

    Raises:
        MeasurementError: the page lacks its header or the marks around its figures.
    """
    Header.read(text)
    if BEGIN not in text or END not in text:
        raise MeasurementError(f"the page lacks {BEGIN} or {END}")
    items = re.compile(r"^- Machine: .+\n(?:- \w+: .+\n)+", re.MULTILINE)
    text = items.sub(lambda _: "\n".join(header.lines()) + "\n", text, count=1)
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    return f"{before}{BEGIN}\n```text\n{figures.strip()}\n```\n{END}{after}"


def measure(page: Path) -> None:
    """Run the command of a page, show what it prints, and write it into the page.

    Raises:
        MeasurementError: it is no page of figures, or the command failed.
    """
    text = page.read_text()
    header = Header.read(text)
    measured = digest(header.measures)
    search = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
    printed = []
    with subprocess.Popen(
        shlex.split(header.command),
        cwd=ROOT,
        env=os.environ | {"PATH": search, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout is not None
        for line in running.stdout:
            print(line, end="", flush=True)
            printed.append(line)
    if running.returncode:
        raise MeasurementError(f"{header.command} ended with {running.returncode}")
    header = replace(
        header,
        machine=machine(),
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        commit=_commit(),
        sources=measured,
        written="by the command",
    )
    page.write_text(rewritten(text, header, "".join(printed)))


def _commit() -> str:
    git = ["git", "-C", str(ROOT)]
    try:
        name = subprocess.run(
            [*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
        )
        changed = subprocess.run(
            [*git, "status", "--porcelain"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    return name.stdout.strip() + (" and changes" if changed.stdout.strip() else "")


def pages() -> list[Path]:
    """Return the pages of figures, by name."""
    return sorted(path for path in PAGES.glob("*.md") if path.name != "README.md")


def main(names: Sequence[str]) -> None:
    for name in names:
        measure(PAGES / f"{name}.md")
    if not names:
        for page in pages():
            print(f"{page.stem:20s} {age(Header.read(page.read_text()))}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (MeasurementError, OSError) as error:
        sys.exit(str(error))
