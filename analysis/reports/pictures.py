"""The pictures of a study: which of the paper's figures its method has, and what they show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import METHODS, WITH_INDICES
from analysis.reports import figures, hover
from analysis.reports.html import data_uri, settle
from analysis.reports.paper import PIXELS_PER_INCH, on_paper
from analysis.reports.wording import words
from analysis.sensitivity.estimators import Estimator
from analysis.sensitivity.table import Table

if TYPE_CHECKING:
    from matplotlib import figure as drawings


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What the pictures are of: one output of a study."""

    table: Table
    snapshot: Mapping[str, Any]
    estimator: Estimator
    output: str
    #: Of the output and of the factors, or "".
    unit: str
    factor_units: Sequence[str]
    #: Factors in the order of their colours; the study's if empty.
    palette: Sequence[str] = ()

    @property
    def order(self) -> Sequence[str]:
        """The factors, the most influential first as far as that is known."""
        units = self.table.plan.units
        known: Sequence[str] | None = self.snapshot["outputs"][self.output]["ranking"]["order"]
        return [factor for unit in known or units for factor in units[unit]]

    @property
    def clouds(self) -> NDArray[np.float64]:
        """mu* and sigma of every replicate, shape (2, replicates, factors)."""
        statistics = self.estimator.statistics()
        o = self.table.plan.outputs.index(self.output)
        return np.stack([statistics[name].weighted[1:, o] for name in ("mu_star", "sigma")])


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure with what it shows."""

    #: Short, for file names.
    name: str
    title: str
    caption: str
    figure: drawings.Figure
    #: What it shows at the pointer (`analysis.reports.hover`).
    panels: Sequence[hover.Panel]

    @property
    def width(self) -> str:
        """How wide it is shown, in pixels."""
        return f"{self.figure.get_figwidth() * PIXELS_PER_INCH:.0f}"

    @property
    def uri(self) -> str:
        """The figure as an SVG image in the page, with clouds of points as pixels inside it."""
        return data_uri(self.figure, "svg")


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """A picture that studies of some methods have."""

    name: str
    title: str
    caption: str
    draw: Callable[[Subject], figures.Figure]
    methods: Sequence[str] = METHODS


_KINDS = (
    _Kind(
        name="plane",
        title="Elementary effects",
        caption="Left: mean magnitude and spread of the elementary effects with their intervals, "
        "each the effect of a factor's whole range; below the dotted line an effect is mostly "
        "monotonic and without interactions, left of the dashed one it is less than a tenth of the "
        "largest. Right: where bootstrap replicates put them. Near the origin a factor does little "
        "(paper, figure 8).",
        methods=("morris",),
        draw=lambda s: figures.plane(s.snapshot, s.output, s.unit, s.clouds, s.palette),
    ),
    _Kind(
        name="shares",
        title="Shares of the variance",
        caption="Share of the output's variance due to a factor alone (S) and in company (ST), "
        "with intervals; ST near 0 means that the factor may take any value; left of the dashed "
        "line, a share of 0.05, it does too little to matter (paper, figure 10).",
        methods=("saltelli", "saltelli_second_order", "surrogate"),
        draw=lambda s: figures.bars(s.snapshot, s.output, s.unit),
    ),
    _Kind(
        name="effects",
        title="Shapley effects",
        caption="Share of the output's variance that a factor has in all, between what it tells of "
        "the output with all that it depends on (full) and what is left of it when every other "
        "factor is known (independent), with intervals; Shapley effects sum to 1 (Song, Nelson and "
        "Staum 2016; Mara and Tarantola 2012).",
        methods=("shapley",),
        draw=lambda s: figures.bars(s.snapshot, s.output, s.unit),
    ),
    _Kind(
        name="together",
        title="Pairs of factors",
        caption="Share of the output's variance that two factors have together beyond what each "
        "has alone (Saltelli 2002), the largest, and the same from growing parts of the sample.",
        methods=("saltelli_second_order",),
        draw=lambda s: figures.together(s.snapshot, s.output),
    ),
    _Kind(
        name="interactions",
        title="Interactions",
        caption="Left: what each factor does in company only, all its interactions together. "
        "Right: shares of the variance of single factors, on the diagonal, and of pairs beyond "
        "what each of the two does alone.",
        methods=("saltelli_second_order",),
        draw=lambda s: figures.interactions(s.snapshot, s.output),
    ),
    _Kind(
        name="convergence",
        title="Convergence",
        caption="The same indices from the first 8, 16, 32, ... rows, of the leading factors. "
        "Bands are intervals, cut off where the first ones would dwarf the rest; lines that still "
        "move ask for more rows (paper, figure 11).",
        methods=WITH_INDICES,
        draw=lambda s: figures.convergence(s.snapshot, s.output, s.unit, s.palette),
    ),
    _Kind(
        name="distribution",
        title="Distribution of the output",
        caption="What the sampled uncertainty does to the output. Variance stands for uncertainty "
        "as far as this has one hump and little skew (paper, figure 9).",
        draw=lambda s: figures.distribution(s.table.sample(s.output)[1], s.output, s.unit),
    ),
    _Kind(
        name="scatter",
        title="Output against each factor",
        caption="Every run, and the mean of each tenth of a factor's range (paper, figure 12).",
        draw=lambda s: figures.scatter(
            *s.table.sample(s.output), s.table.plan.factors, s.output, s.unit, s.factor_units
        ),
    ),
    _Kind(
        name="pairs",
        title="Pairs of the leading factors",
        caption="Two factors against each other, the output as colour. A pattern along a diagonal "
        "hints at an interaction (paper, figure 13).",
        draw=lambda s: figures.pairs(
            *s.table.sample(s.output),
            s.table.plan.factors,
            s.order,
            s.output,
            s.unit,
            s.factor_units,
        ),
    ),
)


def curve_pictures(
    snapshot: Mapping[str, Any], units: Mapping[str, str], palette: Sequence[str]
) -> list[Picture]:
    """Return two figures of every curve of a study (Lamboni et al. 2011), drawn."""
    drawn = []
    for name in snapshot.get("curves", {}):
        unit = units.get(name, "")
        drawn += [
            _picture(
                figures.curve(snapshot, name, unit, palette),
                f"{name}-indices",
                f"{words(name).capitalize()}: indices along the curve",
                "Left: the leading factors, with bands that hold a whole line at once. "
                "Right: all factors, the most influential on the curve as a whole first.",
            ),
            _picture(
                figures.components(snapshot, name, unit),
                f"{name}-components",
                f"{words(name).capitalize()}: principal components",
                "Left: the mean curve, and what one standard deviation of each component's "
                "score adds to it and takes from it. Right: the indices of the scores.",
            ),
        ]
    return drawn


def pictures(subject: Subject) -> list[Picture]:
    """Return every figure of the paper that the study's method has, drawn.

    Raises:
        ValueError: the study has no such output.
    """
    return [
        _picture(kind.draw(subject), kind.name, kind.title, kind.caption)
        for kind in _KINDS
        if subject.snapshot["method"] in kind.methods
    ]


def _picture(figure: figures.Figure, name: str, title: str, caption: str) -> Picture:
    drawn = on_paper(figure)
    settle(drawn)
    return Picture(
        name=name, title=title, caption=caption, figure=drawn, panels=hover.panels(figure, drawn)
    )
