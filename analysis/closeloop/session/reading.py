"""A measured session: `session.json`, its trials and what each field may hold."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.columns import ColumnMap, read_map

SESSION_FILE = "session.json"
#: The model word for the project's own nominal arm in the exoskeleton.
NOMINAL = "nominal"
MAX_TRIALS = 200
MAX_JSON_BYTES = 1_000_000
#: What `session.json` and each of its trials may say.
KEYS = (
    "schema",
    "model",
    "subject",
    "declared_effects",
    "ignored_joints",
    "effort_filter_hz",
    "columns",
    "trials",
)
TRIAL_KEYS = ("file", "label", "group", "role", "added_mass", "effort_filter_hz", "columns")


@dataclass(frozen=True, kw_only=True)
class DeclaredEffect:
    """An effect the user accounts for and whose values are unknown: fitted before and after."""

    effect: str
    joint: str


@dataclass(frozen=True, kw_only=True)
class AddedMass:
    """A known point mass that one trial carried."""

    body: str
    mass: float
    #: In the body's frame, m.
    position: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One recording. Columns are float arrays of one length, under the names of the header."""

    file: str
    label: str
    group: str
    #: "fit" or "holdout".
    role: str
    added_mass: AddedMass | None = None
    #: Known low-pass of the effort channel, Hz.
    effort_filter_hz: float | None = None
    #: How to read a file that has not the contract's own columns.
    source: ColumnMap | None = None
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Session:
    """What `session.json` says; the trials hold their signals once they are read."""

    folder: Path
    model: str
    height_m: float = 1.75
    mass_kg: float = 70.0
    declared: tuple[DeclaredEffect, ...] = ()
    ignored_joints: tuple[str, ...] = ()
    trials: tuple[Trial, ...] = ()
    #: Keys of `session.json` that mean nothing here.
    unknown: tuple[str, ...] = ()


def read_session(folder: Path, known_effects: tuple[str, ...]) -> Session:
    """Read `session.json`; the trials' files are looked at but not yet read.

    Args:
        folder: the session's folder.
        known_effects: names that `declared_effects` may hold.

    Raises:
        SessionError: the folder or the file cannot be used.
    """
    if not folder.is_dir():
        raise SessionError(
            "there is no such folder; name one with a session.json", file=str(folder)
        )
    path = inside(folder, SESSION_FILE, field_name=SESSION_FILE)
    content = _json(path)
    if content.get("schema") != 1 or isinstance(content.get("schema"), bool):
        raise _wrong("schema", f"must be 1, not {content.get('schema')!r}")
    model = _text(content, "model")
    if model != NOMINAL:
        inside(folder, model, field_name="model")
    subject = content.get("subject", {})
    if not isinstance(subject, dict):
        raise _wrong("subject", 'must be an object such as {"height_m": 1.75, "mass_kg": 70}')
    default_filter = _optional_number(content, "effort_filter_hz", "effort_filter_hz", low=0.0)
    return Session(
        folder=folder,
        model=model,
        height_m=_number(subject.get("height_m", 1.75), "subject.height_m", low=0.5, high=2.5),
        mass_kg=_number(subject.get("mass_kg", 70.0), "subject.mass_kg", low=10.0, high=300.0),
        declared=_declared(content, known_effects),
        ignored_joints=_names(content, "ignored_joints"),
        trials=_trials(content, folder, default_filter),
        unknown=_unknown(content),
    )


def inside(folder: Path, name: str, *, field_name: str) -> Path:
    """Return the path of file `name` in `folder`.

    Raises:
        SessionError: the path is absolute, leaves the folder, or there is no such file.
    """
    if (
        PurePosixPath(name).is_absolute()
        or PureWindowsPath(name).is_absolute()
        or PureWindowsPath(name).drive
        or "\\" in name
        or "\0" in name
    ):
        raise _wrong(field_name, f"{name!r} must be a relative path inside the session's folder")
    path = folder / name
    try:
        within, there = path.resolve().is_relative_to(folder.resolve()), path.is_file()
    except (OSError, RuntimeError, ValueError):
        # Too long, a loop of links, or no text that a file system takes.
        raise _wrong(field_name, f"{name[:60]!r} cannot be the name of a file") from None
    if not within:
        raise _wrong(field_name, f"{name!r} leaves the session's folder; keep every file inside it")
    if not there:
        raise SessionError(
            f"there is no such file in {folder.name or folder}"
            + ("" if name == SESSION_FILE else f", but {SESSION_FILE} names it as {field_name}"),
            file=name,
        )
    return path


def _json(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MAX_JSON_BYTES:
        raise SessionError(f"is larger than {MAX_JSON_BYTES} bytes", file=SESSION_FILE)
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_once_each)
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror}", file=SESSION_FILE) from None
    except UnicodeDecodeError:
        raise SessionError("is not UTF-8 text", file=SESSION_FILE) from None
    except json.JSONDecodeError as error:
        raise SessionError(
            f"is not JSON: {error.msg}", file=SESSION_FILE, line=error.lineno
        ) from None
    except SessionError:
        raise
    except RecursionError:
        raise SessionError("is nested too deeply", file=SESSION_FILE) from None
    except ValueError:
        raise SessionError("holds a number with too many digits", file=SESSION_FILE) from None
    if not isinstance(content, dict):
        raise SessionError("must hold one JSON object", file=SESSION_FILE)
    return content


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of its pairs; of two equal keys one would be lost without a word."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise SessionError(f"{twice} stands twice in one object", file=SESSION_FILE)
    return content


def _unknown(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return where the file says something that no analysis reads: often a slip of the pen."""
    found = [name for name in content if name not in KEYS]
    for number, trial in enumerate(content["trials"]):
        found += [f"trials[{number}].{name}" for name in trial if name not in TRIAL_KEYS]
    return tuple(name.encode(errors="backslashreplace").decode() for name in found)


def _declared(
    content: Mapping[str, Any], known_effects: tuple[str, ...]
) -> tuple[DeclaredEffect, ...]:
    entries = _list(content, "declared_effects")
    declared: list[DeclaredEffect] = []
    for number, entry in enumerate(entries):
        where = f"declared_effects[{number}]"
        if not isinstance(entry, dict):
            raise _wrong(where, 'must be an object with "effect" and "joint"')
        effect = _text(entry, "effect", where)
        if effect not in known_effects:
            raise _wrong(
                f"{where}.effect", f"{effect!r} is unknown; take one of {', '.join(known_effects)}"
            )
        found = DeclaredEffect(effect=effect, joint=_text(entry, "joint", where))
        if found in declared:
            raise _wrong(where, f"{effect} of {found.joint} is declared twice")
        declared.append(found)
    return tuple(declared)


def _trials(
    content: Mapping[str, Any], folder: Path, default_filter: float | None
) -> tuple[Trial, ...]:
    session_map = read_map(content.get("columns"), folder, "columns", inside)
    entries = content.get("trials")
    if not isinstance(entries, list) or not entries:
        raise _wrong("trials", "must list at least one trial")
    if len(entries) > MAX_TRIALS:
        raise _wrong("trials", f"lists {len(entries)} trials; at most {MAX_TRIALS} are analysed")
    trials: list[Trial] = []
    paths: set[Path] = set()
    for number, entry in enumerate(entries):
        where = f"trials[{number}]"
        if not isinstance(entry, dict):
            raise _wrong(where, 'must be an object with "file"')
        file = _text(entry, "file", where)
        path = inside(folder, file, field_name=f"{where}.file").resolve()
        if path in paths:
            raise _wrong(f"{where}.file", f"{file!r} is listed twice; list each trial once")
        paths.add(path)
        role = entry.get("role", "fit")
        if role not in ("fit", "holdout"):
            raise _wrong(f"{where}.role", f"must be 'fit' or 'holdout', not {role!r}")
        label, group = entry.get("label", file), entry.get("group", file)
        if not (_is_text(label) and _is_text(group)):
            raise _wrong(where, "label and group must be text")
        own_map = read_map(entry.get("columns"), folder, f"{where}.columns", inside)
        filter_hz = _optional_number(
            entry, "effort_filter_hz", f"{where}.effort_filter_hz", low=0.0
        )
        trials.append(
            Trial(
                file=file,
                label=label,
                group=group,
                role=role,
                added_mass=_added_mass(entry.get("added_mass"), f"{where}.added_mass"),
                effort_filter_hz=default_filter if filter_hz is None else filter_hz,
                source=own_map or session_map,
            )
        )
    if all(trial.role == "holdout" for trial in trials):
        raise _wrong("trials", "every trial is a holdout; at least one must be there to be fitted")
    return tuple(trials)


def _added_mass(entry: Any, where: str) -> AddedMass | None:
    if entry is None:
        return None
    if not isinstance(entry, dict):
        raise _wrong(where, 'must be an object with "body", "mass_kg" and "position"')
    position = entry.get("position", [0, 0, 0])
    if not isinstance(position, list) or len(position) != 3:
        raise _wrong(f"{where}.position", "must be three numbers in m, in the body's frame")
    x, y, z = (_number(value, f"{where}.position", low=-10.0, high=10.0) for value in position)
    return AddedMass(
        body=_text(entry, "body", where),
        mass=_number(entry.get("mass_kg"), f"{where}.mass_kg", low=0.0, high=1000.0),
        position=(x, y, z),
    )


def _wrong(where: str, detail: str) -> SessionError:
    return SessionError(f"{where} {detail}", file=SESSION_FILE)


def _list(content: Mapping[str, Any], name: str) -> list[Any]:
    entries = content.get(name, [])
    if not isinstance(entries, list):
        raise _wrong(name, "must be a list")
    return entries


def _names(content: Mapping[str, Any], name: str) -> tuple[str, ...]:
    entries = _list(content, name)
    if not all(isinstance(entry, str) for entry in entries):
        raise _wrong(name, "must be a list of joint names")
    return tuple(entries)


def _text(content: Mapping[str, Any], name: str, where: str = "") -> str:
    value = content.get(name)
    if not isinstance(value, str) or not value:
        raise _wrong(f"{where}.{name}" if where else name, f"must be a name, not {value!r}")
    return value


def _optional_number(
    content: Mapping[str, Any], name: str, where: str, *, low: float
) -> float | None:
    value = content.get(name)
    return None if value is None else _number(value, where, low=low, high=float("inf"))


def _number(value: Any, where: str, *, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
        raise _wrong(where, f"must be a finite number, not {str(value)[:40]}")
    if not low < value <= high and not (low < 0 and value == low):
        raise _wrong(where, f"must be more than {low:g} and at most {high:g}, not {value:g}")
    return float(value)


def _is_text(value: Any) -> bool:
    """Say whether a JSON value is text that can be written: JSON can hold half a character."""
    return isinstance(value, str) and value == value.encode(errors="replace").decode()


def _finite(value: float) -> bool:
    try:
        return isfinite(value)
    except OverflowError:
        return False
