"""What is analysed of a sheet: factors, outputs, and the rows that have all of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.given.doubts.stand_ins import atom, no_value
from analysis.given.rows import layout
from analysis.given.rows.copies import FEWEST_ROWS, without_copies
from analysis.given.rows.missing import lacking
from analysis.given.table.cells import on_one_line
from analysis.given.table.reading import Sheet
from analysis.given.table.refusals import GivenError
from models.entries import RESULT_COLUMNS

Array = NDArray[np.float64]

#: Factors times outputs at most: what the measures take is proportional to them.
MOST_PAIRS = 1000
#: Columns that are shown of a table, and characters of their names.
_SHOWN, _QUOTED = 30, 60


@dataclass(frozen=True, kw_only=True)
class Sample:
    """Factors and outputs of the rows of a file, in its order; nan where there is none."""

    file: str
    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    #: Shape (rows, factors) and (rows, outputs).
    x: Array
    y: Array
    #: What was left out and what a reader should know, a sentence each.
    remarks: tuple[str, ...]

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which rows have all factors and outputs, shape (rows,)."""
        return _finite(self.x) & _finite(self.y)


def choose(
    sheet: Sheet, outputs: Sequence[str] = (), factors: Sequence[str] | None = None
) -> Sample:
    """Return the sample of a sheet.

    Args:
        outputs: names of columns; of a study's own table they are known (default: all of them).
        factors: names of columns; default: every other column of numbers that varies.

    Raises:
        GivenError: a column is missing, text, or does not vary; too few rows have all cells; or
            there are too many of both.
    """
    known_factors, known_outputs = _of_a_study(sheet)
    if known_outputs:
        sheet = _in_order(sheet)
    outputs = list(dict.fromkeys(_called(sheet, name) for name in outputs)) or known_outputs
    if not outputs:
        shown = _listed(list(sheet.numbers))
        named = "its lines have no names; " if sheet.unlabelled else ""
        raise GivenError(
            f"{named}say which column is the output: it has {shown or 'no column of numbers'}",
            file=sheet.file,
        )
    for name in outputs:
        _check_column(sheet, name)
    remarks: list[str] = []
    if sheet.numbered:
        remarks.append(
            f"Its first line, {_listed(list(sheet.columns))}, is taken for the names of columns, "
            "as programs number them: if it is a run, give every column a name."
        )
    if factors is None:
        factors = known_factors or [name for name in sheet.numbers if name not in outputs]
        counting = [name for name in factors if _counts(sheet.numbers[name])]
        rest = [name for name in factors if name not in counting]
        # A file of one factor may be a sweep of it.
        if not known_factors and counting and any(_varies(sheet.numbers[name]) for name in rest):
            factors = rest
            remarks.append(
                f"Columns that only count the rows are left out: {', '.join(counting)}. "
                "If one is a factor, name all factors (--factor)."
            )
        texts = {} if known_factors else sheet.texts
        if shown := ", ".join(f"{name} ({text[:20]!r})" for name, text in texts.items() if text):
            remarks.append(f"Columns of text are left out: {shown}.")
        if shown := ", ".join(name for name, text in texts.items() if not text):
            remarks.append(f"Columns that are empty are left out: {shown}.")
    else:
        factors = list(dict.fromkeys(_called(sheet, name) for name in factors))
        for name in factors:
            _check_column(sheet, name)
            if name in outputs:
                raise GivenError(
                    f"{name} cannot be a factor and an output", file=sheet.file, column=name
                )
    if len(factors) * len(outputs) > MOST_PAIRS:
        raise GivenError(
            f"it has {len(factors)} factors and {len(outputs)} outputs, and factors times outputs "
            f"are {MOST_PAIRS} at most: name those to look at (--factor, --output)",
            file=sheet.file,
        )
    return _sample(sheet, factors, outputs, remarks)


def _sample(
    sheet: Sheet, factors: Sequence[str], outputs: Sequence[str], remarks: list[str]
) -> Sample:
    # Before rows: what a column lacks that is left out costs none.
    varying = [name for name in factors if _varies(sheet.numbers[name])] or factors
    still = [name for name in factors if name not in varying]
    factors = varying
    names = (*factors, *outputs)
    table = np.column_stack([sheet.numbers[name] for name in names])
    first = _laid_out_or_new(table[:, : len(factors)], table[:, len(factors) :])
    if copies := len(table) - len(first):
        remarks.append(
            f"{copies} of {len(table)} rows "
            + ("is an exact copy of another" if copies == 1 else "are exact copies of others")
            + ", which tell nothing new: left out."
        )
        table = table[first]
        kept = {name: table[:, n] for n, name in enumerate(names)}
        sheet = replace(sheet, numbers=kept)
    lines = len(table)
    complete = _finite(table)
    if complete.sum() < FEWEST_ROWS:
        least = f"and not the {FEWEST_ROWS} or more that indices need"
        if lines < FEWEST_ROWS:
            which = "different rows" if copies else "rows"
            raise GivenError(f"it has {lines} {which}, {least}", file=sheet.file)
        emptiest = max((*factors, *outputs), key=lambda n: np.isnan(sheet.numbers[n]).sum())
        raise GivenError(
            f"only {complete.sum()} of its {lines} rows have all factors and outputs, {least}; "
            f"{emptiest} has most of the empty cells",
            file=sheet.file,
            column=emptiest,
        )
    if not complete.all():
        remarks += [lacking(names, table), *_of_other_outputs(names, len(factors), table)]
    for name in outputs:
        if np.ptp(sheet.numbers[name][complete]) == 0.0:
            raise GivenError(
                f"{name} is the same in all {complete.sum()} rows: there is nothing to explain",
                file=sheet.file,
                column=name,
            )
    still += [name for name in factors if np.ptp(sheet.numbers[name][complete]) == 0.0]
    if still:
        remarks.append(f"Columns that do not vary are left out: {', '.join(still)}.")
    factors = [name for name in factors if name not in still]
    if not factors:
        raise GivenError("it has no factor that varies", file=sheet.file)
    remarks += [
        said for name in (*factors, *outputs) if (said := no_value(name, sheet.numbers[name]))
    ]
    remarks += [said for name in outputs if (said := atom(name, sheet.numbers[name]))]
    x = np.column_stack([sheet.numbers[name] for name in factors])
    return Sample(
        file=sheet.file,
        factors=tuple(factors),
        outputs=tuple(outputs),
        x=x,
        y=np.column_stack([sheet.numbers[name] for name in outputs]),
        remarks=tuple(remarks),
    )


def _of_other_outputs(names: Sequence[str], factors: int, table: Array) -> list[str]:
    """Return the remark on outputs that lose rows to what others lack.

    Args:
        names: of factors and outputs.
        factors: how many.
        table: their columns, shape (rows, factors and outputs).
    """
    used = int(_finite(table).sum())
    alone = {
        name: int(_finite(table[:, [*range(factors), factors + o]]).sum())
        for o, name in enumerate(names[factors:])
    }
    more = [f"{name} would have {rows:,}" for name, rows in alone.items() if rows > used]
    if not more:
        return []
    return [
        f"Only the {used:,} rows are used that have all outputs: alone {', '.join(more)}. Ask for "
        "one output at a time (--output) to use them."
    ]


def _laid_out_or_new(x: Array, y: Array) -> NDArray[np.intp]:
    """Return the rows of a table without copies; all of them if only so they are a design.

    Points of one meet where a factor has few values, and its indices need every one of them.
    """
    kept = without_copies(x, y)
    if len(kept) == len(x):
        return kept
    moved = x[:, np.ptp(x, axis=0) != 0.0]
    if not layout.recognise(moved[kept]):
        return np.arange(len(x)) if layout.recognise(moved) else kept
    return kept


def _of_a_study(sheet: Sheet) -> tuple[list[str], list[str]]:
    """Return factors and outputs of a study's own table; nothing of any other."""
    if not set(RESULT_COLUMNS) <= set(sheet.columns):
        return [], []
    # The order of a study's columns tells factors from outputs (`analysis.files.results_csv`).
    split = sheet.columns.index("outcome")
    own = sheet.numbers.keys() - set(RESULT_COLUMNS)
    numbers = [name for name in sheet.columns if name in own]
    return (
        [name for name in numbers if name in sheet.columns[:split]],
        [name for name in numbers if name in sheet.columns[split:]],
    )


def _in_order(sheet: Sheet) -> Sheet:
    """Return a study's own table row by row, as its design is."""
    order = np.lexsort((sheet.numbers["position"], sheet.numbers["row"]))
    return replace(sheet, numbers={name: one[order] for name, one in sheet.numbers.items()})


def _counts(column: Array) -> bool:
    """Say whether a column is a number of the row, one more or one less in every line."""
    steps = np.diff(column)
    return bool(
        len(steps)
        and abs(steps[0]) == 1.0
        and (steps == steps[0]).all()
        and (column == np.round(column)).all()
    )


def _varies(column: Array) -> bool:
    there = column[~np.isnan(column)]
    return bool(len(there) and np.ptp(there) > 0.0)


def _finite(values: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)


def _called(sheet: Sheet, name: str) -> str:
    """Return a column's whole name if only its unit is lacking: y of "y [Nm]" or "y (Nm)"."""
    name = on_one_line(name)
    whole = [one for one in sheet.columns if re.split(r"\s*[\[(]", one, maxsplit=1)[0] == name]
    return whole[0] if name not in sheet.columns and len(whole) == 1 else name


def _listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them: so many, and of each so much, as is read."""
    shown = ", ".join(
        name if len(name) <= _QUOTED else f"{name[:_QUOTED]}..." for name in names[:_SHOWN]
    )
    return shown + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def _check_column(sheet: Sheet, name: str) -> None:
    if sheet.texts.get(name) == "":
        raise GivenError(f"column {name} is empty", file=sheet.file, column=name)
    if name in sheet.texts:
        raise GivenError(
            f"column {name} is text ({sheet.texts[name][:20]!r}): indices need numbers, such as a "
            "code for each of its values",
            file=sheet.file,
            column=name,
        )
    if name not in sheet.numbers:
        raise GivenError(
            f"it has no column {name[:_QUOTED]!r}: it has {_listed(sheet.columns)}",
            file=sheet.file,
        )
