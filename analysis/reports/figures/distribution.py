"""Distribution of an output over the factors' distributions (paper, figure 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.style import FAINT, INK, new_figure, open_axes, say
from analysis.reports.wording import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def distribution_figure(values: NDArray[np.float64], output: str, unit: str = "") -> Figure:
    """Draw a histogram, a kernel density estimate, and the normal density of the same moments.

    The kernel is Gaussian with Scott's bandwidth (`scipy.stats.gaussian_kde`). How normal the
    output looks says how far its variance stands for its uncertainty (paper, section 3.2).

    Args:
        values: finite, shape (n,).
    """
    # A coordinator that shows a study's tables draws nothing, and this takes a second to import.
    from scipy.stats import gaussian_kde, norm, skew

    figure = new_figure(7.0, 4.2)
    axes = figure.subplots()
    per_unit = f"1/({unit})" if unit else ""
    open_axes(axes, with_unit(output, unit), with_unit("probability density", per_unit))
    if values.size < 2 or np.ptp(values) == 0.0:
        say(axes, "nothing varies yet")
        return figure
    mean, sd = float(np.mean(values)), float(np.std(values, ddof=1))
    low, high = np.quantile(values, [0.0, 1.0]) + np.array([-0.4, 0.4]) * sd
    x = np.linspace(low, high, 400)
    bins = min(max(int(np.sqrt(values.size)), 8), 60)
    axes.hist(values, bins=bins, density=True, color="#9CC9E8", edgecolor="white", lw=0.4)
    axes.plot(x, gaussian_kde(values)(x), color="#0072B2", lw=2.0, label="kernel density")
    axes.plot(x, norm.pdf(x, mean, sd), color=FAINT, lw=1.2, ls="--", label="normal, same moments")
    axes.axvline(mean, color="#D55E00", lw=1.4, label=f"mean {mean:.3g}")
    axes.axvline(0.0, color=INK, lw=0.6) if low < 0.0 < high else None
    axes.set_title(
        f"{values.size:,} runs: mean {mean:.3g}{' ' + unit if unit else ''}, standard deviation "
        f"{sd:.3g}, skewness {float(skew(values)):.2g}",
        fontsize=11,
    )
    axes.legend(frameon=False, fontsize=9)
    return figure
