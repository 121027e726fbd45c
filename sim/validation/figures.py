"""Pictures of the validations, laid out like the paper's figures 3 and 6."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sim.pictures.figures import new_figure
from sim.validation.compression import OGNEVA_CONTRACTED, OGNEVA_RELAXED, CompressionTest
from sim.validation.isometric import ANGLES_DEG, MEASURED, IsometricTest
from sim.validation.moment_arms import ANGLES_DEG as MOVED_DEG
from sim.validation.moment_arms import PIGEON, SUGISAKI, measured_mm

#: Colour and place of the peak's label of each set of muscles.
_STYLES = (("tab:orange", -48), ("tab:green", 0), ("tab:blue", 48))


def isometric_figure(tests: Mapping[str, IsometricTest], path: Path) -> Path:
    """Draw both torque curves over the elbow angle beside the measured data; return `path`.

    Args:
        tests: of arms with each of `sim.body.muscles.elbow.ELBOW_MUSCLES`, by its name.
        path: the picture.
    """
    figure = new_figure(width=9.0, height=3.8)
    for column, title in enumerate(("Flexion", "Extension")):
        attribute = f"{title.lower()}_nm"
        axes = figure.add_subplot(1, 2, column + 1)
        for data, marker in zip(MEASURED, ("o", "s"), strict=True):
            axes.plot(
                data.angles_deg,
                getattr(data, attribute),
                marker + "--",
                color="0.55",
                markersize=4,
                linewidth=1,
                label=data.source,
            )
        for (label, arm), (colour, shift) in zip(tests.items(), _STYLES, strict=True):
            axes.plot(ANGLES_DEG, getattr(arm, attribute), color=colour, linewidth=2, label=label)
            torque, angle = getattr(arm, f"{title.lower()}_peak")
            axes.plot([angle], [torque], "o", color=colour)
            axes.annotate(
                f"{torque:.0f} Nm at {angle:.0f}°",
                (angle, torque),
                textcoords="offset points",
                xytext=(shift, 8 if torque > 0 else -22),
                ha="center",
                color=colour,
            )
        axes.margins(y=0.15)
        flexion, torque_label = "elbow flexion (degrees)", "torque about the elbow (Nm)"
        axes.set(title=f"Isometric {title.lower()}", xlabel=flexion, ylabel=torque_label)
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(path)
    return path


def moment_arm_figure(arms: Mapping[str, Mapping[str, np.ndarray]], path: Path) -> Path:
    """Draw the moment arm of each muscle over the elbow angle beside the measured; return `path`.

    Args:
        arms: by set of muscles and by muscle, mm over `moment_arms.ANGLES_DEG`.
        path: the picture.
    """
    figure = new_figure(width=9.0, height=6.0)
    for number, muscle in enumerate(PIGEON, start=1):
        axes = figure.add_subplot(2, 2, number)
        for (name, ours), (colour, _) in zip(arms.items(), _STYLES, strict=True):
            axes.plot(MOVED_DEG, ours[muscle], color=colour, linewidth=2, label=name)
        axes.plot(MOVED_DEG, measured_mm(muscle), "--", color="0.4", label="Pigeon et al. 1996")
        axes.set(title=muscle, xlabel="elbow flexion (degrees)", ylabel="moment arm (mm)")
        if muscle == "triceps":
            means, deviations = zip(*SUGISAKI.values(), strict=True)
            people = "Sugisaki et al. 2010 (2 sd)"
            axes.errorbar(
                list(SUGISAKI), means, 2.0 * np.array(deviations), fmt="ks", capsize=3, label=people
            )
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(path)
    return path


def compression_figure(tests: Sequence[CompressionTest], path: Path) -> Path:
    """Draw stress and secant modulus over strain with the measured moduli; return `path`."""
    figure = new_figure(width=9.0, height=4.2)
    stress, modulus = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    for test, colour in zip(tests, ("tab:cyan", "tab:blue", "tab:purple"), strict=True):
        label = f"{test.elasticity:.0f} N/m"
        percent = 100 * test.strain
        stress.plot(percent, test.stress / 1e3, "o-", color=colour, markersize=3, label=label)
        modulus.plot(percent, test.modulus / 1e3, "o-", color=colour, markersize=3, label=label)
    strain = np.linspace(0.0, 0.28, 2)
    for value, style, label in (
        (OGNEVA_RELAXED, "-", "relaxed muscle (Ogneva et al. 2010)"),
        (OGNEVA_CONTRACTED, "--", "contracted muscle"),
    ):
        stress.plot(100 * strain, value * strain / 1e3, style, color="tab:green", label=label)
        modulus.axhline(value / 1e3, linestyle=style, color="tab:green")
    modulus.axhspan(OGNEVA_RELAXED / 1e3, OGNEVA_CONTRACTED / 1e3, color="tab:green", alpha=0.12)
    title = "Compression of the upper arm's tissue"
    stress.set(title=title, ylabel="compressive stress (kPa)")
    modulus.set(title="Secant Young's modulus", ylabel="modulus (kPa)")
    for axes in (stress, modulus):
        axes.set_xlabel("strain (%)")
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
    handles, labels = stress.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    figure.savefig(path)
    return path
