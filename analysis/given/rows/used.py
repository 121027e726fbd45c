"""Which rows of a sample indices are told from: those that nobody laid out, as far as one sees.

Designs that lay them out are those of Saltelli et al. 2010 and Morris 1991; walks and crossed rows
are no draws of their own, so that intervals from so many rows are too narrow (Kish 1965, Survey
sampling, section 5.4, on the effect of clusters).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.given.rows import layout
from analysis.given.rows.copies import FEWEST_ROWS
from analysis.given.rows.groups import in_trajectories, together
from analysis.given.rows.order import chain
from analysis.given.rows.sample import Sample
from analysis.given.rows.spread import in_parts, quasi_random, sharing_nothing

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Used:
    """What indices of samples are told from."""

    #: Shapes (rows, factors) and (rows, outputs), in no order.
    x: Array
    y: Array
    #: Which of them is first in the file, which second, ..., shape (rows,).
    order: NDArray[np.intp]
    #: Whether the rows may have been drawn independently.
    drawn: bool
    #: The layout that was recognised.
    design: layout.Layout | None
    remarks: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """Rows of which no two share what others of the table do."""

    rows: NDArray[np.intp]
    #: Whether they may have been drawn independently.
    drawn: bool
    remarks: Sequence[str]


def used(sample: Sample) -> Used:
    """Return the rows that nobody laid out, as far as that can be seen."""
    rows = np.flatnonzero(sample.complete)
    design = layout.recognise(sample.x)
    found = _no_design(sample, rows) if design is None else _of_design(sample, design)
    # Rows may come sorted by a factor, and equal values would then stay sorted.
    rows = np.random.default_rng(0).permutation(len(found.rows))
    rows = found.rows[rows]
    return Used(
        x=sample.x[rows],
        y=sample.y[rows],
        order=np.argsort(rows),
        drawn=found.drawn,
        design=design,
        remarks=found.remarks,
    )


def _of_design(sample: Sample, design: layout.Layout) -> _Drawn:
    """Return the rows of a design that share no value by design."""
    remarks = [design.sentence]
    rows = design.independent[sample.complete[design.independent]]
    if len(rows) < FEWEST_ROWS:
        remarks.append(
            f"Only {len(rows)} of its runs share no value by design, and {FEWEST_ROWS} are "
            "needed for the indices of samples: those of the design are all there is."
        )
        rows = rows[:0]
    return _Drawn(rows=rows, drawn=True, remarks=remarks)


def _no_design(sample: Sample, rows: NDArray[np.intp]) -> _Drawn:
    """Return the rows of a table that is no design, or those that share nothing if it has parts."""
    x = sample.x[rows]
    if parts := in_parts(x):
        said = (
            f"{parts} of {len(rows)} rows differ from another in one factor only, as parts of a "
            "Saltelli or Morris design do: they are not drawn independently. {use}If it is a "
            "design, give every line of it, in its order."
        )
        return _sharing_nothing(rows, sharing_nothing(x), said)
    if groups := together(x):
        apart = sharing_nothing(x[:, [f for group in groups for f in group]])
        named = "; ".join(", ".join(sample.factors[f] for f in group) for group in groups)
        said = (
            f"Values of factors repeat together ({named}), as where settings are crossed or "
            f"nested, or a design moves groups of factors: {len(apart):,} of {len(rows):,} rows "
            "share none, and the others are no draws of their own, unless there are no other "
            "values. "
        )
        return _sharing_nothing(rows, apart, said.replace("{", "{{").replace("}", "}}") + "{use}")
    if width := in_trajectories(x):
        said = (
            f"The sample is walks of {width} rows that move every factor once, several at a time, "
            "as a Morris design of groups is: rows are not drawn independently. Intervals are too "
            "narrow."
        )
        return _Drawn(rows=rows, drawn=False, remarks=[said])
    if (one := chain(x, sample.y[rows])) and not quasi_random(x):
        return _Drawn(rows=rows, drawn=False, remarks=[one.sentence(sample.factors, len(rows))])
    return _Drawn(rows=rows, drawn=True, remarks=[])


def _sharing_nothing(rows: NDArray[np.intp], apart: NDArray[np.intp], said: str) -> _Drawn:
    """Return the rows that share no value if they are enough, and what to say of it.

    Args:
        rows: all of them.
        apart: which of these share no value.
        said: with a place for what is used.
    """
    enough = len(apart) >= FEWEST_ROWS
    use = f"Only the {len(apart):,} rows that share no value are used. " if enough else ""
    return _Drawn(
        rows=rows[apart] if enough else rows,
        drawn=enough,
        remarks=[said.format(use=use or "Intervals are too narrow. ").strip()],
    )
