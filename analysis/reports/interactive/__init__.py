"""Figures of studies for plotly.js, as JSON: {"data", "layout", "table"}.

The same indices in the same colours, order and words as the figures of a report
(`analysis.reports.figures`), but what the pointer touches tells its values, and they move as
results arrive. "table" is {"head", "rows"}: what the figure shows as numbers. Ink, grid and font
are the page's own.
"""

from analysis.reports.interactive.bars import bars
from analysis.reports.interactive.convergence import convergence
from analysis.reports.interactive.plane import plane
from analysis.reports.interactive.precision import precision

__all__ = ["bars", "convergence", "plane", "precision"]
