"""One trial's CSV file: a header, then numbers; every fault is named with its column and line."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.columns import (
    check_width,
    csv_lines,
    masked,
    no_number,
    translated,
)
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.files import like, read_text
from intake.words import counted
from intake.xml import listed

TIME = "time"
#: Endings of logs that hold no text, which `rehyb inspect` reads.
LOGS = (".bag", ".mcap", ".db3", ".mat", ".npz", ".npy", ".h5", ".hdf5")
MAX_BYTES = 400_000_000
MAX_COLUMNS = 500
MIN_SAMPLES = 50
#: Share of a file's samples that may be left out for a missing cell or as copies.
MOST_LEFT_OUT = 0.01
#: Signals of a joint.
OF_JOINTS = ("position", "velocity", "acceleration", "effort")
#: Larger than seconds since 1970 and any torque or force.
MAX_VALUE = 1e12
#: By so much (s) may `from` and `to` lie outside of a file without a word.
SURPLUS = 1.0
#: A step back by more median steps begins another trial; a smaller one is a stamp that is wrong.
ANEW = 10
#: `from` and `to` of a trial that is all of its file.
WHOLE = (-np.inf, np.inf)


def read_trial(
    folder: Path, trial: Trial, joints: tuple[str, ...], declared: tuple[str, ...] = ()
) -> Trial:
    """Return `trial` with its signals.

    Args:
        joints: joints of the model of which a position must be recorded.
        declared: joints with a declared effect, which need an effort to fit it to.

    Raises:
        SessionError: the file cannot be used.
    """
    if Path(trial.file).suffix in LOGS:
        raise SessionError(
            f"is no CSV file: `rehyb inspect {trial.file} --out DIR` writes one of it",
            file=trial.file,
        )
    text = read_text(folder / trial.file, trial.file, MAX_BYTES)
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise SessionError("holds a zero byte; is it a CSV file?", file=trial.file, line=line)
    if trial.source is not None:
        names, table, first, repairs = translated(text, trial.file, trial.source)
        repairs += _check_header(names, trial.file, joints, declared)
        lines = np.arange(first, first + len(table))
    else:
        names, table, lines, repairs = _own_table(text, trial.file, joints, declared)
    empty, table = np.ma.getmaskarray(table), np.ma.getdata(table)
    # What is not of the trial may be damaged.
    if trial.span != WHOLE:
        clock = table[:, names.index(TIME)]
        within = (trial.span[0] <= clock) & (clock <= trial.span[1])
        repairs = [*repairs, *_beyond(trial, clock)]
        table, lines, empty = table[within], lines[within], empty[within]
    keep, whole = _whole_cells(names, empty, lines, joints, trial.file, repairs)
    names = [name for name, kept in zip(names, keep, strict=True) if kept]
    table, lines = table[whole][:, keep], lines[whole]
    _check_values(table, names, lines, trial.file)
    once = _first_of_each(table, lines, trial.file, repairs)
    table, lines = table[once], lines[once]
    _check_time(table[:, names.index(TIME)], lines, trial.file)
    if len(table) < MIN_SAMPLES:
        why = f"has {len(table)} samples{trial.part}; at least {MIN_SAMPLES} are needed"
        end = len(table) + 1 if trial.span == WHOLE else None
        raise SessionError(why, file=trial.file, line=end)
    columns = {name: table[:, i] for i, name in enumerate(names) if name != TIME}
    return replace(
        trial,
        time=table[:, names.index(TIME)],
        columns=columns,
        lines=lines,
        repairs=tuple(repairs),
    )


def _beyond(trial: Trial, clock: np.ndarray) -> list[str]:
    """Say if a trial is to last from before its file begins, or until after it ends."""
    known = clock[np.isfinite(clock)]
    first, last = (known.min(), known.max()) if len(known) else WHOLE
    low, high = trial.span
    said = []
    if first - low > SURPLUS and np.isfinite(low):
        said.append(f"from is {low:g} s, and the file begins at {first:g} s: is it meant?")
    if high - last > SURPLUS and np.isfinite(high):
        said.append(f"to is {high:g} s, and the file ends at {last:g} s: is it meant?")
    return said


def _own_table(
    text: str, file: str, joints: tuple[str, ...], declared: tuple[str, ...]
) -> tuple[list[str], np.ndarray, np.ndarray, list[str]]:
    """Read a file with the contract's header; return names, table, its lines and repairs."""
    header, _, body = text.partition("\n")
    try:
        names = [name.strip() for name in next(csv.reader([header]), [])]
    except csv.Error as error:
        raise SessionError(f"has no header of a CSV file: {error}", file=file, line=1) from None
    if TIME not in names and (";" in header or "\t" in header):
        why = (
            "separate columns by commas and decimals by points, or name the separator in columns "
            "of session.json; decimals need a point there, too"
        )
        raise SessionError(why, file=file, line=1)
    doubts = _check_header(names, file, joints, declared)
    table, lines, repairs = _numbers(body, names, file)
    return names, table, lines, doubts + repairs


def _check_header(
    names: list[str], file: str, joints: tuple[str, ...], declared: tuple[str, ...]
) -> list[str]:
    """Return in sentences which columns may be efforts by a slip of the pen."""
    if len(names) > MAX_COLUMNS:
        raise SessionError(f"has {len(names)} columns; at most {MAX_COLUMNS}", file=file, line=1)
    for number, name in enumerate(names):
        if not name:
            raise SessionError(f"column {number + 1} has no name", file=file, line=1)
        if name in names[:number]:
            raise SessionError("stands twice in the header", file=file, column=name, line=1)
    hint = "or list a joint that no trial records in ignored_joints of session.json"
    needed = {TIME: f"the header needs a column {TIME}"}
    for joint in joints:
        position = f"{joint}.position"
        needed[position] = f"the header needs a column {position}, {hint}"
    for joint in declared:
        needed[f"{joint}.effort"] = (
            f"{joint} has a declared effect, which needs its motor torque to fit"
        )
    efforts = [f"{joint}.effort" for joint in joints]
    if not any(name in names for name in efforts):
        needed.setdefault(
            efforts[0], f"at least one joint needs its motor torque ({', '.join(efforts)})"
        )
    missing = [name for name in needed if name not in names]
    if missing:
        name, *others = missing
        too = f"; so are {listed(others)}" if others else ""
        too += "".join(f"; is {other} meant?" for other in like(name, {*names} - needed.keys()))
        raise SessionError(f"is missing; {needed[name]}{too}", file=file, column=name, line=1)
    spare = [n for n in names if n.endswith(".effort") and n not in efforts]
    return [
        f"column {other} is no joint's of the model, and {name} is missing: is it meant?"
        for name in efforts
        if name not in names
        for other in like(name, spare)
    ]


def _numbers(body: str, names: list[str], file: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Parse the lines below the header fast; only a file with a fault is read line by line.

    Returns:
        Numbers of shape (n, columns), masked where a cell is empty; the line of each row, (n,);
        what was left out: a last line without its end was cut off.
    """
    if not body.strip():
        return np.empty((0, len(names))), np.empty(0, dtype=int), []
    try:
        table = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2, comments=None)
        # loadtxt skips blank lines, which would shift every line number after them.
        if table.shape[1] == len(names) and len(table) == body.rstrip("\r\n").count("\n") + 1:
            return table, np.arange(2, len(table) + 2), []
    except (ValueError, UserWarning):
        pass
    rows: list[list[float | None]] = []
    lines: list[int] = []
    last = body.count("\n") + 2
    repairs = []
    for number, cells in enumerate(csv_lines(body, file), start=2):
        if not cells and not body.splitlines()[number - 1 :]:
            break
        if number == last and len(cells) < len(names):
            repairs.append(f"line {number} is cut off, and was left out")
            continue
        check_width(cells, names, file, number)
        row: list[float | None] = []
        for name, cell in zip(names, cells, strict=True):
            try:
                row.append(float(cell) if cell.strip() else None)
            except ValueError:
                raise no_number(cell, name, file, number) from None
        rows.append(row)
        lines.append(number)
    return masked(rows).reshape(len(rows), len(names)), np.array(lines), repairs


def _whole_cells(
    names: list[str],
    empty: np.ndarray,
    lines: np.ndarray,
    joints: tuple[str, ...],
    file: str,
    repairs: list[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Return which columns and which samples are kept of a table with empty cells; note the others.

    A line with one is a sample that the logger missed. A column that no joint needs is left out as
    a whole if it has more of them: some are written only now and then.
    """
    needed = {TIME, *(f"{joint}.{signal}" for joint in joints for signal in OF_JOINTS)}
    share = empty.mean(axis=0) if len(empty) else np.zeros(len(names))
    spare = np.array([name not in needed for name in names]) & (share > MOST_LEFT_OUT)
    for at in np.flatnonzero(spare):
        count = int(empty[:, at].sum())
        repairs.append(
            f"column {names[at]} is empty in {count} of {len(empty)} samples, and was left out"
        )
    lacking = empty & ~spare
    missed = lacking.any(axis=1)
    if missed.any():
        row = int(np.argmax(missed))
        name, count = names[int(np.argmax(lacking[row]))], int(missed.sum())
        _require_few(count, len(empty), "is empty", file, name, int(lines[row]))
        said = counted(count, "sample with an empty cell was", "samples with an empty cell were")
        repairs.append(f"{said} left out")
    return np.logical_not(spare), np.logical_not(missed)


def _require_few(count: int, among: int, what: str, file: str, column: str, line: int) -> None:
    """Refuse a file of whose samples too many would have to be left out."""
    if count > MOST_LEFT_OUT * among:
        why = (
            f"{what}, as in {count} of {among} samples; at most {MOST_LEFT_OUT:.0%} may be left out"
        )
        raise SessionError(why, file=file, column=column, line=line)


def _first_of_each(
    table: np.ndarray, lines: np.ndarray, file: str, repairs: list[str]
) -> np.ndarray:
    """Return which samples are no copy of the one before, stamp and all; note how many are."""
    once = np.ones(len(table), dtype=bool)
    once[1:] = (np.diff(table, axis=0) != 0.0).any(axis=1)
    if not once.all():
        copies = int(np.sum(~once))
        _require_few(
            copies, len(table), "repeats a sample", file, TIME, int(lines[np.argmin(once)])
        )
        said = counted(copies, "sample that repeats", "samples that repeat")
        repairs.append(f"{said} the one before {'was' if copies == 1 else 'were'} left out")
    return once


def _check_values(table: np.ndarray, names: list[str], lines: np.ndarray, file: str) -> None:
    for wrong, why in (
        (~np.isfinite(table), "not a finite number; remove the row (a gap is allowed)"),
        (
            np.abs(table) > MAX_VALUE,
            "which nothing in SI units is at a joint; leave damaged lines out by the trial's "
            "from and to",
        ),
    ):
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            found = f"holds {table[row, column]:g}, {why}"
            raise SessionError(found, file=file, column=names[column], line=int(lines[row]))


def _check_time(time: np.ndarray, lines: np.ndarray, file: str) -> None:
    if len(time) < 2:
        return
    steps = np.diff(time)
    step = float(np.median(steps))
    line, detail = 3, ""
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        line, detail = (
            int(lines[row]),
            f"must increase, but {time[row]:g} follows {time[row - 1]:g}",
        )
        if steps[row - 1] < -ANEW * float(np.median(np.abs(steps))):
            detail += (
                "; if the clock begins anew there with another trial, cut the file at this line, "
                "as `rehyb inspect FILE --out DIR` does"
            )
    elif step > 0.2:
        detail = f"steps by {step:g}; time is in seconds and needs at least 5 samples a second"
        detail += " (are these milliseconds?)" if step >= 0.5 else ""
    elif step < 1e-5:
        detail = f"steps by {step:g} s; more than 100 kHz is not a joint's record"
    if detail:
        raise SessionError(detail, file=file, column=TIME, line=line)
