"""Figures of studies, each named after what it shows, as data that plotly.js reads.

Pages draw them with plotly.js, and reports and files with matplotlib (`analysis.reports.paper`):
one description each, so that a study looks the same wherever it is shown
(docs/decisions/0013-a-figure-is-described-once.md). One that is given a snapshot of another
method, or without the output, raises ValueError.
"""

from analysis.reports.figures.campaign import campaign
from analysis.reports.figures.comparison import comparison
from analysis.reports.figures.convergence import convergence
from analysis.reports.figures.curves import components, curve
from analysis.reports.figures.distribution import distribution
from analysis.reports.figures.failures import failures
from analysis.reports.figures.interactions import interactions, together
from analysis.reports.figures.pairs import pair, pairs
from analysis.reports.figures.parallel import parallel
from analysis.reports.figures.plane import plane
from analysis.reports.figures.precision import precision
from analysis.reports.figures.scatter import against, scatter
from analysis.reports.figures.shared import Figure
from analysis.reports.figures.shares import bars

__all__ = [
    "Figure",
    "against",
    "bars",
    "campaign",
    "comparison",
    "components",
    "convergence",
    "curve",
    "distribution",
    "failures",
    "interactions",
    "pair",
    "pairs",
    "parallel",
    "plane",
    "precision",
    "scatter",
    "together",
]
