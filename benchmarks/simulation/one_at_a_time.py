"""Each factor of Table 1 alone over its range, the others nominal: curves and what they are like.

`python -m benchmarks.simulation.one_at_a_time FILE.png [CONDITION=VALUE ...]`
"""

import sys
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.machine import describe_machine
from sim.assessment.assess import assess
from sim.parameters.wearer import TABLE_1
from sim.pictures.figures import new_figure

POINTS = 21
ERRORS = ("stiffness_error", "stiffness_error_authors")
#: What is drawn, each with its style.
QUANTITIES = {
    "stiffness_error": "o-k",
    "stiffness_error_authors": "--k",
    "stiffness_estimate": "o-C0",
    "stiffness_true": "o-C3",
}


def run(values: dict[str, float]) -> list[float]:
    outputs = assess(values).outputs
    return [outputs.get(quantity, np.nan) for quantity in QUANTITIES]


def roughness(curve: np.ndarray) -> float:
    """Return the rms distance of a curve from a cubic through 5 neighbours, as share of its range.

    A smooth curve has next to none, a jagged one much.
    """
    window = np.arange(5) - 2.0
    fit = np.polynomial.polynomial.polyvander(window, 2)
    smooth = fit @ np.linalg.pinv(fit)
    middles = np.array([curve[i - 2 : i + 3] for i in range(2, len(curve) - 2)])
    return float(np.sqrt(np.mean((middles[:, 2] - middles @ smooth[2]) ** 2)) / np.ptp(curve))


def linearity(x: np.ndarray, curve: np.ndarray) -> float:
    """Return r squared of a straight line."""
    return float(np.corrcoef(x, curve)[0, 1] ** 2)


def print_errors(name: str, grids: dict[str, np.ndarray], errors: np.ndarray) -> None:
    """Print what each factor does to one error, of shape (factors, points)."""
    print(f"{name + ', Nm/rad':34s} low    high   range  r2 of a line  roughness")
    for (factor, grid), error in zip(grids.items(), errors, strict=True):
        print(
            f"{factor:30s} {error[0]:7.2f} {error[-1]:7.2f} {np.ptp(error):7.2f} "
            f"{linearity(grid, error):13.3f} {roughness(error):10.2%}"
        )


def main(path: Path, conditions: dict[str, float]) -> None:
    print(describe_machine())
    grids = {f.name: np.linspace(f.low, f.high, POINTS) for f in TABLE_1}
    jobs = [{**conditions, name: float(x)} for name, grid in grids.items() for x in grid]
    with get_context("spawn").Pool(2) as pool:
        results = np.array(pool.map(run, jobs, chunksize=1)).reshape(len(grids), POINTS, -1)
    for error in ERRORS:
        print_errors(error, grids, results[:, :, list(QUANTITIES).index(error)])
    figure = new_figure(width=10.0, height=6.0)
    for i, factor in enumerate(TABLE_1):
        axes = figure.add_subplot(2, 3, i + 1)
        for curve, (quantity, style) in zip(results[i].T, QUANTITIES.items(), strict=True):
            axes.plot(grids[factor.name], curve, style, markersize=3, label=quantity)
        axes.axvline(factor.nominal, color="0.8", zorder=0)
        axes.set_xlabel(f"{factor.name.replace('_', ' ')} ({factor.unit})")
        axes.set_ylim(-7.0, max(9.0, 0.5 + np.nanmax(results)))
        if i % 3 == 0:
            axes.set_ylabel("Nm/rad")
        if i == 0:
            axes.legend(frameon=False, fontsize=7)
    figure.savefig(path)
    print(path)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(
            "usage: python -m benchmarks.simulation.one_at_a_time FILE.png [CONDITION=VALUE ...]"
        )
    chosen = (argument.split("=") for argument in sys.argv[2:])
    main(Path(sys.argv[1]), {name: float(value) for name, value in chosen})
