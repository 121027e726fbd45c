"""Logs of other layouts: a small map from their signals to the contract's columns, as data.

The map says in which lines or columns the signals stand and how their numbers become SI units
(`value = scale * number + offset`); `docs/use/recorded_logs.md` has the words and two examples.
"""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}
LAYOUTS = ("columns", "rows")
MAX_MAP_BYTES = 100_000
KEYS = ("layout", "preset", "separator", "rate_hz", "map")
SOURCE_KEYS = ("from", "scale", "offset")

#: Bench of the NESM exoskeleton (data/20210208_EFE of github stesfazgi/rehyb_mujoco): 33 lines
#: without a header, one signal each: a count at 100 Hz, then for abduction, flexion, rotation and
#: elbow the desired torque, spring angle, joint angle, actual torque and current; angles in
#: degrees, torque in Nm. The other lines hold desired positions, gravity torques, motor counts.
NESM_BENCH: Mapping[str, Any] = {
    "layout": "rows",
    "map": {
        "time": {"from": 1, "scale": 0.01},
        **{
            f"J{joint}.{word}": source
            for joint, first in ((1, 2), (2, 7), (3, 12), (4, 17))
            for word, source in (
                ("position", {"from": first + 2, "scale": pi / 180}),
                ("effort", {"from": first + 3}),
            )
        },
        "J4.desired_torque": {"from": 17},
    },
}
PRESETS: Mapping[str, Mapping[str, Any]] = {"nesm_bench": NESM_BENCH}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where one signal stands, and what makes it SI."""

    #: A name of the header, or the number of a line or column, counted from 1.
    signal: str | int
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """How to read a foreign log."""

    #: "columns": one sample a line under a header; "rows": one signal a line, no header.
    layout: str
    separator: str
    #: Clock of a log that has none, Hz.
    rate_hz: float | None
    sources: Mapping[str, Source]


def read_map(content: Any, folder: Path, where: str, inside: Any) -> ColumnMap | None:
    """Return the map that a session or trial names, or None if it names none.

    Args:
        content: None, the name of a preset, the name of a JSON file in the folder, or an object.
        folder: the session's folder.
        where: what to call it in an error.
        inside: finds a file of the folder, or raises (`analysis.closeloop.session.reading.inside`).

    Raises:
        SessionError: the map cannot be used.
    """
    file = "session.json"
    if content is None:
        return None
    if isinstance(content, str) and content in PRESETS:
        content = {"preset": content}
    elif isinstance(content, str):
        path, file = inside(folder, content, field_name=where), content
        content, where = _json(path, content), "columns"
    if not isinstance(content, dict):
        raise SessionError(
            f"{where} must be an object, a file of the folder or one of {', '.join(PRESETS)}",
            file=file,
        )
    return _map(content, where, file)


def _map(content: Mapping[str, Any], where: str, file: str) -> ColumnMap:
    for key in content:
        if key not in KEYS:
            raise _wrong(file, f"{where}.{key}", f"is unknown; take {', '.join(KEYS)}")
    preset = content.get("preset")
    if preset is not None and (not isinstance(preset, str) or preset not in PRESETS):
        raise _wrong(file, f"{where}.preset", f"must be one of {', '.join(PRESETS)}")
    base = PRESETS[preset] if preset else {}
    layout = content.get("layout", base.get("layout", "columns"))
    if layout not in LAYOUTS:
        raise _wrong(file, f"{where}.layout", f"must be one of {', '.join(LAYOUTS)}")
    separator = content.get("separator", "comma")
    if not isinstance(separator, str) or separator not in SEPARATORS:
        raise _wrong(file, f"{where}.separator", f"must be one of {', '.join(SEPARATORS)}")
    own = content.get("map", {})
    if not isinstance(own, dict) or not (own or base):
        raise _wrong(file, f"{where}.map", 'must be an object such as {"time": {"from": "t"}}')
    rate = content.get("rate_hz")
    if rate is not None and (not _number(rate) or not 5.0 <= rate <= 1e5):
        raise _wrong(file, f"{where}.rate_hz", "must be a number of Hz, 5 to 100000")
    sources = {
        name: _source(entry, layout, f"{where}.map.{name}", file)
        for name, entry in {**base.get("map", {}), **own}.items()
    }
    if ("time" in sources) == (rate is not None):
        raise _wrong(
            file, f"{where}.map", "needs a time, or rate_hz for a log without a clock, not both"
        )
    return ColumnMap(layout=layout, separator=SEPARATORS[separator], rate_hz=rate, sources=sources)


def _source(entry: Any, layout: str, where: str, file: str) -> Source:
    if isinstance(entry, str | int) and not isinstance(entry, bool):
        entry = {"from": entry}
    if not isinstance(entry, dict) or any(key not in SOURCE_KEYS for key in entry):
        raise _wrong(file, where, 'must be an object such as {"from": "angle", "scale": 0.0174533}')
    signal = entry.get("from")
    numbered = isinstance(signal, int) and not isinstance(signal, bool) and signal >= 1
    if not numbered and (layout == "rows" or not isinstance(signal, str) or not signal):
        wanted = "the number of a line, from 1" if layout == "rows" else "a name of the header"
        raise _wrong(file, f"{where}.from", f"must be {wanted}, not {signal!r}")
    scale, offset = entry.get("scale", 1.0), entry.get("offset", 0.0)
    if not _number(scale) or scale == 0 or not _number(offset):
        raise _wrong(file, where, "needs finite numbers as scale and offset, and no scale of 0")
    assert isinstance(signal, str | int)
    return Source(signal=signal, scale=float(scale), offset=float(offset))


def translated(text: str, file: str, columns: ColumnMap) -> tuple[list[str], np.ndarray]:
    """Return the contract's column names and their table, (n, columns), of a foreign log.

    Raises:
        SessionError: a signal is missing or holds what is no number.
    """
    lines = _lines(text, file, columns.separator)
    if columns.layout == "rows":
        signals = {name: _row(lines, s, name, file) for name, s in columns.sources.items()}
    else:
        signals = {name: _column(lines, s, name, file) for name, s in columns.sources.items()}
    lengths = {name: len(values) for name, values in signals.items()}
    if len(set(lengths.values())) > 1:
        shortest = min(lengths, key=lambda name: lengths[name])
        raise SessionError(
            f"holds {lengths[shortest]} numbers; other lines have {max(lengths.values())}",
            file=file,
            column=shortest,
            line=_at(columns.sources[shortest]),
        )
    if columns.rate_hz is not None:
        count = next(iter(lengths.values()))
        signals = {"time": np.arange(count) / columns.rate_hz, **signals}
    return list(signals), np.column_stack(list(signals.values()))


def _lines(text: str, file: str, separator: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in text.rstrip().splitlines()]
    reader = csv.reader(io.StringIO(text.rstrip()), delimiter=separator)
    try:
        return list(reader)
    except csv.Error as error:
        raise SessionError(f"is no CSV: {error}", file=file, line=reader.line_num + 1) from None


def _row(lines: list[list[str]], source: Source, name: str, file: str) -> np.ndarray:
    assert isinstance(source.signal, int)
    if source.signal > len(lines):
        raise SessionError(
            f"is missing: the map takes it from line {source.signal}, and there are {len(lines)}",
            file=file,
            column=name,
        )
    cells = [cell for cell in lines[source.signal - 1] if cell.strip()]
    numbers = [_parsed(cell, name, file, source.signal) for cell in cells]
    return source.scale * np.array(numbers, dtype=float) + source.offset


def _column(lines: list[list[str]], source: Source, name: str, file: str) -> np.ndarray:
    header = [cell.strip() for cell in lines[0]] if lines else []
    if isinstance(source.signal, int):
        at = source.signal - 1
        known = at < len(header)
    else:
        known = source.signal in header
        at = header.index(source.signal) if known else 0
    if not known:
        raise SessionError(
            f"is missing: the map takes it from {source.signal!r}, and the header has "
            f"{', '.join(header[:20])[:200] or 'nothing'}",
            file=file,
            column=name,
            line=1,
        )
    numbers = []
    for number, cells in enumerate(lines[1:], start=2):
        if len(cells) != len(header):
            raise SessionError(
                f"has {len(cells)} cells; the header has {len(header)}", file=file, line=number
            )
        numbers.append(_parsed(cells[at], name, file, number))
    return source.scale * np.array(numbers, dtype=float) + source.offset


def _parsed(cell: str, name: str, file: str, line: int) -> float:
    try:
        return float(cell)
    except ValueError:
        raise SessionError(
            f"holds {cell.strip()[:40]!r}, not a number", file=file, column=name, line=line
        ) from None


def _at(source: Source) -> int | None:
    return source.signal if isinstance(source.signal, int) else None


def _json(path: Path, name: str) -> Any:
    if path.stat().st_size > MAX_MAP_BYTES:
        raise SessionError(f"is larger than {MAX_MAP_BYTES} bytes", file=name)
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except json.JSONDecodeError as error:
        raise SessionError(f"is not JSON: {error.msg}", file=name, line=error.lineno) from None
    except (UnicodeDecodeError, RecursionError, ValueError):
        raise SessionError("is not JSON", file=name) from None


def _number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return isfinite(value)
    except OverflowError:
        return False


def _wrong(file: str, where: str, detail: str) -> SessionError:
    return SessionError(f"{where} {detail}", file=file)
