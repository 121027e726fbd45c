"""Files of a session's folder: found inside it, read under limits, their JSON checked by field.

Whatever is wrong is a `SessionError` that names the file, and the field where there is one.
"""

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from analysis.closeloop.errors import SessionError
from analysis.json_values import is_finite_number

SESSION_FILE = "session.json"


def inside(folder: Path, name: str, *, field_name: str) -> Path:
    """Return the path of file `name` in `folder`.

    Raises:
        SessionError: the path is absolute, leaves the folder, or there is no such file.
    """

    def wrong(detail: str) -> SessionError:
        return SessionError(f"{field_name} {detail}", file=SESSION_FILE)

    if (
        PurePosixPath(name).is_absolute()
        or PureWindowsPath(name).is_absolute()
        or PureWindowsPath(name).drive
        or "\\" in name
        or "\0" in name
    ):
        raise wrong(f"{name!r} must be a relative path inside the session's folder")
    path = folder / name
    try:
        within, there = path.resolve().is_relative_to(folder.resolve()), path.is_file()
    except (OSError, RuntimeError, ValueError):
        # Too long, a loop of links, or no text that a file system takes.
        raise wrong(f"{name[:60]!r} cannot be the name of a file") from None
    if not within:
        raise wrong(f"{name!r} leaves the session's folder; keep every file inside it")
    if not there:
        what = f"there is no such file in {folder.name or folder}"
        if path.exists():
            what = "is a folder, not a file" if path.is_dir() else "is no regular file"
        why = what + (
            "" if name == SESSION_FILE else f", but {SESSION_FILE} names it as {field_name}"
        )
        raise SessionError(why, file=name)
    return path


def read_text(path: Path, name: str, most_bytes: int) -> str:
    """Return the text of a file that errors call `name`.

    Raises:
        SessionError: the file is too large, is not UTF-8, or cannot be read.
    """
    if path.stat().st_size > most_bytes:
        million = 1_000_000
        most = f"{most_bytes // million} MB" if most_bytes > million else f"{most_bytes} bytes"
        raise SessionError(f"is larger than {most}", file=name)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SessionError("is not UTF-8 text", file=name) from None
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror}", file=name) from None


def read_json(
    path: Path,
    name: str,
    most_bytes: int,
    make_object: Callable[[list[tuple[str, Any]]], dict[str, Any]] = dict,
) -> Any:
    """Return the content of a JSON file that errors call `name`.

    Args:
        most_bytes: that it may have.
        make_object: makes an object of its pairs of names and values, or raises SessionError.

    Raises:
        SessionError: the file cannot be read or is not JSON.
    """
    text = read_text(path, name, most_bytes)
    try:
        return json.loads(text, object_pairs_hook=make_object)
    except json.JSONDecodeError as error:
        raise SessionError(f"is not JSON: {error.msg}", file=name, line=error.lineno) from None
    except SessionError:
        raise
    except RecursionError:
        raise SessionError("is nested too deeply", file=name) from None
    except ValueError:
        raise SessionError("holds a number with too many digits", file=name) from None


def like(name: str, others: Iterable[str]) -> list[str]:
    """Return the one of `others` that a slip of the pen makes of a name, if there is one."""
    plain = {other.lower(): other for other in others}
    return [plain[near] for near in get_close_matches(name.lower(), plain, n=1, cutoff=0.75)]


@dataclass(frozen=True)
class Fields:
    """One JSON object of a file, whose fields are taken by name and checked."""

    content: Mapping[str, Any]
    file: str
    #: Where the object is in the file, as `trials[0]`; empty for the file's own object.
    where: str = ""

    def get(self, name: str, default: Any = None) -> Any:
        """Return a field as it is, unchecked."""
        return self.content.get(name, default)

    def path(self, name: str) -> str:
        """Return what errors call a field, or this object if the name is empty."""
        return ".".join(part for part in (self.where, name) if part)

    def wrong(self, name: str, detail: str) -> SessionError:
        """Return an error about a field, or about this object if the name is empty."""
        return SessionError(f"{self.path(name)} {detail}", file=self.file)

    def there(self, name: str) -> None:
        """Raise a SessionError unless a field is there; of a slip of the pen it says so."""
        if name not in self.content:
            near = "".join(f"; is {other} meant?" for other in like(name, self.content))
            raise self.wrong(name, f"is missing{near}")

    def text(self, name: str) -> str:
        """Return a text that must be there and not be empty."""
        self.there(name)
        value = self.get(name)
        if not isinstance(value, str) or not value:
            raise self.wrong(name, f"must be a name, not {value!r}")
        return value

    def choice(self, name: str, choices: Collection[str], default: str | None = None) -> str:
        """Return one of a few words."""
        value = self.get(name, default)
        if not isinstance(value, str) or value not in choices:
            raise self.wrong(name, f"must be one of {', '.join(choices)}")
        return value

    def number(
        self, name: str, default: float | None = None, *, low: float = 0.0, high: float = inf
    ) -> float:
        """Return a number between `low`, which a negative bound includes, and `high`."""
        return self.checked_number(name, self.get(name, default), low=low, high=high)

    def checked_number(self, name: str, value: Any, *, low: float, high: float) -> float:
        """Return `value`, which stands in field `name`, if it is a number between the bounds."""
        if not is_finite_number(value):
            raise self.wrong(name, f"must be a finite number, not {str(value)[:40]}")
        if not low < value <= high and not (low < 0 and value == low):
            most = "" if high == inf else f" and at most {high:g}"
            raise self.wrong(name, f"must be more than {low:g}{most}, not {value:g}")
        return float(value)

    def vector(
        self, name: str, *, most: float, wanted: str, default: list[float] | None = None
    ) -> tuple[float, float, float]:
        """Return three numbers between -`most` and `most`; `wanted` says what they are."""
        value = self.get(name, default)
        if not isinstance(value, list) or len(value) != 3:
            raise self.wrong(name, f"must be {wanted}")
        x, y, z = (self.checked_number(name, each, low=-most, high=most) for each in value)
        return x, y, z

    def entries(self, name: str) -> list[Any]:
        """Return a list; without the field an empty one."""
        entries = self.get(name, [])
        if not isinstance(entries, list):
            raise self.wrong(name, "must be a list")
        return entries

    def part(self, name: str, value: Any, wanted: str) -> "Fields":
        """Return the object `value` of field `name`; `wanted` says in an error what it must be."""
        if not isinstance(value, dict):
            raise self.wrong(name, f"must be an object {wanted}")
        return Fields(value, self.file, self.path(name))
