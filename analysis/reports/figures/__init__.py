"""Figures of studies, each named after what it shows; they return a matplotlib `Figure`.

One that is given a snapshot of another method, or without the output, raises ValueError.
matplotlib is imported when a figure is drawn, so that a coordinator without it can run.
"""

from analysis.reports.figures.campaign import campaign_figure
from analysis.reports.figures.convergence import convergence_figure
from analysis.reports.figures.curves import components_figure, curve_figure
from analysis.reports.figures.distribution import distribution_figure
from analysis.reports.figures.interactions import interactions_figure
from analysis.reports.figures.pairs import pairs_figure
from analysis.reports.figures.plane import screening_figure
from analysis.reports.figures.scatter import scatter_figure
from analysis.reports.figures.shares import variance_figure
from analysis.reports.figures.together import together_figure

__all__ = [
    "campaign_figure",
    "components_figure",
    "convergence_figure",
    "curve_figure",
    "distribution_figure",
    "interactions_figure",
    "pairs_figure",
    "scatter_figure",
    "screening_figure",
    "together_figure",
    "variance_figure",
]
