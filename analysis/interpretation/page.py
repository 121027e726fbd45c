"""The answer as one page: the interval beside published ranges first, methods last.

Its text is in `analysis/reports/templates/interpretation.html`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.reports.html import data_uri, render
from sim.pictures.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Published stiffness of the passive elbow, Nm/rad, restoring: words, low, high, source.
BANDS = (
    (
        "relaxed, healthy",
        0.4,
        1.8,
        "Relaxed and healthy, 0.40 to 1.8 Nm/rad: Wiegner and Watts 1986, n = 19.",
    ),
)
NOTES = (
    "After stroke a catch may be locally 16 Nm/rad: McPherson et al. 2018, n = 13, one digitised "
    "curve.",
    "Stiffness that a subject makes by co-contraction is no sign of disease, and may be below 0 in "
    "the muscles' working range.",
)


def write_page(path: Path, found: Mapping[str, Any], before: float | None = None) -> None:
    """Write an answer as HTML with its picture inside.

    Args:
        path: the page.
        found: of `analysis.interpretation.answer.interpret`.
        before: half width without what was measured on the patient, Nm/rad.
    """
    page = render(
        "interpretation.html",
        title="Stiffness of the elbow",
        found=found,
        before=before,
        verdict=in_words(found),
        tolerance=tolerance_in_words(found),
        picture=data_uri(_picture(found), "png", dpi=100),
        sources=[*(source for *_, source in BANDS), *NOTES],
    )
    path.write_text(page, encoding="utf-8")


def in_words(found: Mapping[str, Any]) -> str:
    """Say where the interval lies among the published ranges."""
    low, high = found["stiffness"]["interval90"]
    _, below, above, _ = BANDS[0]
    if high < below:
        return "It is less stiff than relaxed healthy elbows."
    if low > above:
        return "It is stiffer than relaxed healthy elbows."
    if below <= low and high <= above:
        return "It is as stiff as relaxed healthy elbows."
    return "It cannot be told from relaxed healthy elbows: the interval reaches into their range."


def tolerance_in_words(found: Mapping[str, Any]) -> str:
    """Say whether the interval is as narrow as was wanted, and else what makes it so."""
    asked = found["tolerance"]
    if asked is None:
        return ""
    wanted = f"{asked['value']:g} Nm/rad"
    if asked["inside"]:
        return f"The half width of the 90 % interval is below {wanted}, as was wanted."
    if asked["plan"]:
        names = ", ".join(step["factor"] for step in asked["plan"]["steps"])
        return f"To come below {wanted} in {asked['plan']['minutes']:g} minutes measure {names}."
    if "why_no_plan" in asked:
        return f"There is no plan for {wanted}: {asked['why_no_plan']}."
    return f"No plan of those below reaches {wanted}."


def _picture(found: Mapping[str, Any]) -> "Figure":
    figure = new_figure(width=8.0, height=1.9)
    axes = figure.add_subplot(1, 1, 1)
    for name, low, high, _ in BANDS:
        axes.axvspan(low, high, color="#bfe3d0", lw=0)
        axes.text((low + high) / 2, 1.28, name, ha="center", va="bottom", fontsize=8)
    entry = found["stiffness"]
    colour = "#0072b2" if found["familiar"] else "#d55e00"
    axes.plot(entry["interval90"], [1, 1], color=colour, lw=3, solid_capstyle="butt")
    axes.plot(entry["interval50"], [1, 1], color=colour, lw=10, solid_capstyle="butt", alpha=0.7)
    axes.plot([entry["median"]], [1], "|", color="white", ms=14, mew=2)
    low, high = entry["interval90"]
    axes.set_xlim(min(-0.5, low - 0.5), max(6.0, high + 0.5))
    axes.set_ylim(0.6, 1.55)
    if by_sets := found["if_muscles_of_bank"]:
        ends = by_sets["stiffness"]["interval90"]
        axes.plot(ends, [0.75, 0.75], color="#777777", lw=2, solid_capstyle="butt")
        # On the side that has room.
        words = "  if the muscles are one of the bank's sets  "
        x, align = (ends[1], "left") if sum(ends) < sum(axes.get_xlim()) else (ends[0], "right")
        axes.text(x, 0.75, words, va="center", ha=align, fontsize=7)
    axes.set_yticks([])
    axes.set_xlabel("stiffness, Nm/rad (thick: 50 %, thin: 90 %)", fontsize=9)
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    return figure
