"""Logs of other layouts: a small map from their signals to the contract's columns, as data.

The map says in which lines or columns the signals stand and how their numbers become SI units
(`value = scale * number + offset`); `docs/use/recorded_logs.md` has the words and two examples.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.contents import ColumnMap, Source
from analysis.closeloop.session.files import Fields, inside, read_json
from analysis.json_values import is_finite_number

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}
LAYOUTS = ("columns", "rows")
MAX_MAP_BYTES = 100_000
KEYS = ("layout", "preset", "separator", "rate_hz", "map")
SOURCE_KEYS = ("from", "scale", "offset")
SOURCE_WANTED = 'such as {"from": "angle", "scale": 0.0174533}'

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


def read_map(owner: Fields, name: str, folder: Path) -> ColumnMap | None:
    """Return the map that a session or trial names, or None if it names none.

    Args:
        name: the field: null, a preset, a JSON file of the folder, or the map itself.

    Raises:
        SessionError: the map cannot be used.
    """
    content, file, where = owner.get(name), owner.file, owner.path(name)
    if content is None:
        return None
    if isinstance(content, str) and content in PRESETS:
        content = {"preset": content}
    elif isinstance(content, str):
        path, file = inside(folder, content, field_name=where), content
        content, where = read_json(path, content, MAX_MAP_BYTES), "columns"
    if not isinstance(content, dict):
        raise SessionError(
            f"{where} must be an object, a file of the folder or one of {', '.join(PRESETS)}",
            file=file,
        )
    return _map(Fields(content, file, where))


def _map(fields: Fields) -> ColumnMap:
    for key in fields.content:
        if key not in KEYS:
            raise fields.wrong(key, f"is unknown; take {', '.join(KEYS)}")
    base: Mapping[str, Any] = {}
    if fields.get("preset") is not None:
        base = PRESETS[fields.choice("preset", PRESETS)]
    layout = fields.choice("layout", LAYOUTS, base.get("layout", "columns"))
    separator = fields.choice("separator", SEPARATORS, "comma")
    own = fields.get("map", {})
    if not isinstance(own, dict) or not (own or base):
        raise fields.wrong("map", 'must be an object such as {"time": {"from": "t"}}')
    rate = fields.get("rate_hz")
    if rate is not None and (not is_finite_number(rate) or not 5.0 <= rate <= 1e5):
        raise fields.wrong("rate_hz", "must be a number of Hz, 5 to 100000")
    sources = {
        signal: _source(fields, f"map.{signal}", entry, layout)
        for signal, entry in {**base.get("map", {}), **own}.items()
    }
    if ("time" in sources) == (rate is not None):
        raise fields.wrong("map", "needs a time, or rate_hz for a log without a clock, not both")
    return ColumnMap(layout=layout, separator=SEPARATORS[separator], rate_hz=rate, sources=sources)


def _source(fields: Fields, name: str, entry: Any, layout: str) -> Source:
    """Return the source that stands as `entry` in field `name` of the map's `fields`."""
    if isinstance(entry, str | int) and not isinstance(entry, bool):
        entry = {"from": entry}
    own = fields.part(name, entry, SOURCE_WANTED)
    if any(key not in SOURCE_KEYS for key in entry):
        raise own.wrong("", f"must be an object {SOURCE_WANTED}")
    signal = own.get("from")
    numbered = isinstance(signal, int) and not isinstance(signal, bool) and signal >= 1
    if not numbered and (layout == "rows" or not isinstance(signal, str) or not signal):
        wanted = "the number of a line, from 1" if layout == "rows" else "a name of the header"
        raise own.wrong("from", f"must be {wanted}, not {signal!r}")
    scale, offset = own.get("scale", 1.0), own.get("offset", 0.0)
    if not is_finite_number(scale) or scale == 0 or not is_finite_number(offset):
        raise own.wrong("", "needs finite numbers as scale and offset, and no scale of 0")
    return Source(signal=signal, scale=float(scale), offset=float(offset))


def translated(
    text: str, file: str, columns: ColumnMap
) -> tuple[list[str], np.ndarray, int, list[str]]:
    """Return the contract's column names, their table (n, columns), its first line, and repairs.

    A first line of numbers alone is a sample, of a log without a header. A last line that was cut
    off is left out. Empty cells of a log with one sample a line are masked.

    Raises:
        SessionError: a signal is missing or holds something that is not a number.
    """
    lines = _lines(text, file, columns.separator)
    repairs = []
    if columns.layout == "columns" and len(lines) > 2 and len(lines[-1]) < len(lines[-2]):
        repairs.append(f"line {len(lines)} is cut off, and was left out")
        del lines[-1]
    take = _row if columns.layout == "rows" else _column
    signals = {
        name: source.scale * masked(take(lines, source, name, file)) + source.offset
        for name, source in columns.sources.items()
    }
    lengths = {name: len(values) for name, values in signals.items()}
    if len(set(lengths.values())) > 1:
        shortest = min(lengths, key=lambda name: lengths[name])
        signal = columns.sources[shortest].signal
        why = f"holds {lengths[shortest]} numbers; other lines have {max(lengths.values())}"
        raise SessionError(
            why, file=file, column=shortest, line=signal if isinstance(signal, int) else None
        )
    if columns.rate_hz is not None:
        count = next(iter(lengths.values()))
        signals = {"time": np.arange(count) / columns.rate_hz, **signals}
    first = 1 if columns.layout == "columns" and _all_numbers(lines[:1]) else 2
    return list(signals), np.ma.column_stack(list(signals.values())), first, repairs


def masked(numbers: Sequence[float | None] | Sequence[Sequence[float | None]]) -> np.ndarray:
    """Return numbers as an array of their shape, masked where there is none: an empty cell.

    A cell that says nan is no empty one, and whoever wrote it is asked what it means.
    """
    values = np.array(numbers, dtype=float)
    empty = np.isnan(values)
    cells = np.array(numbers, dtype=object)[empty]
    empty[empty] = [cell is None for cell in cells]
    return np.ma.masked_array(values, empty)


def _all_numbers(lines: list[list[str]]) -> bool:
    try:
        return bool(lines) and all(isfinite(float(cell)) for line in lines for cell in line)
    except ValueError:
        return False


def _lines(text: str, file: str, separator: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in text.rstrip().splitlines()]
    return list(csv_lines(text.rstrip(), file, separator))


def csv_lines(text: str, file: str, separator: str = ",") -> Iterator[list[str]]:
    """Yield the cells of each line of `text`.

    Raises:
        SessionError: a line is no CSV.
    """
    reader = csv.reader(io.StringIO(text), delimiter=separator)
    try:
        yield from reader
    except csv.Error as error:
        raise SessionError(f"is no CSV: {error}", file=file, line=reader.line_num + 1) from None


def check_width(cells: list[str], header: list[str], file: str, line: int) -> None:
    """Refuse a line that has more or fewer cells than the header."""
    if len(cells) != len(header):
        raise SessionError(
            f"has {len(cells)} cells; the header has {len(header)}", file=file, line=line
        )


def _row(lines: list[list[str]], source: Source, name: str, file: str) -> list[float | None]:
    assert isinstance(source.signal, int)
    if source.signal > len(lines):
        why = f"is missing: the map takes it from line {source.signal}, and there are {len(lines)}"
        raise SessionError(why, file=file, column=name)
    cells = [cell for cell in lines[source.signal - 1] if cell.strip()]
    return [_parsed(cell, name, file, source.signal) for cell in cells]


def _column(lines: list[list[str]], source: Source, name: str, file: str) -> list[float | None]:
    header = [cell.strip() for cell in lines[0]] if lines else []
    first = 1 if _all_numbers(lines[:1]) else 2
    if isinstance(source.signal, int):
        at = source.signal - 1
        known = at < len(header)
    else:
        known = source.signal in header
        at = header.index(source.signal) if known else 0
    if not known:
        why = (
            f"is missing: the map takes it from {source.signal!r}, and the header has "
            f"{', '.join(header[:20])[:200] or 'nothing'}"
        )
        raise SessionError(why, file=file, column=name, line=1)
    numbers: list[float | None] = []
    for number, cells in enumerate(lines[first - 1 :], start=first):
        check_width(cells, header, file, number)
        cell = cells[at].strip()
        numbers.append(_parsed(cell, name, file, number) if cell else None)
    return numbers


def _parsed(cell: str, name: str, file: str, line: int) -> float:
    try:
        return float(cell)
    except ValueError:
        raise no_number(cell, name, file, line) from None


def no_number(cell: str, name: str, file: str, line: int) -> SessionError:
    """Return the error for a cell that holds no number; a decimal comma is told what it is."""
    shown = cell.strip()[:40]
    why = f"holds {shown!r}, not a number"
    if re.fullmatch(r"[-+]?\d+,\d+([eE][-+]?\d+)?", shown):
        right = shown.replace(",", ".")
        why = f"holds {shown!r}, with a decimal comma; write decimals with a point, as {right}"
    return SessionError(why, file=file, column=name, line=line)
