"""Each factor of Table 1 alone over its range, the others nominal: curves and what they are like.

`python -m benchmarks.one_at_a_time FILE.png [CONDITION=VALUE ...]`
"""

import sys
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.machine import describe_machine
from sim.assessment import assess
from sim.factors import TABLE_1
from sim.figures import new_figure

POINTS = 21
QUANTITIES = ("stiffness_error", "stiffness_estimate", "stiffness_true")


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


def main(path: Path, conditions: dict[str, float]) -> None:
    print(describe_machine())
    grids = {f.name: np.linspace(f.low, f.high, POINTS) for f in TABLE_1}
    jobs = [{**conditions, name: float(x)} for name, grid in grids.items() for x in grid]
    with get_context("spawn").Pool(2) as pool:
        results = np.array(pool.map(run, jobs, chunksize=1)).reshape(len(grids), POINTS, -1)
    print("stiffness_error, Nm/rad     low    high   range  r2 of a line  roughness")
    figure = new_figure(width=10.0, height=6.0)
    for i, factor in enumerate(TABLE_1):
        grid, curves = grids[factor.name], results[i]
        error = curves[:, 0]
        print(
            f"{factor.name:22s} {error[0]:7.2f} {error[-1]:7.2f} {np.ptp(error):7.2f} "
            f"{linearity(grid, error):12.3f} {roughness(error):10.2%}"
        )
        axes = figure.add_subplot(2, 3, i + 1)
        for j, (quantity, colour) in enumerate(
            zip(QUANTITIES, ("black", "tab:blue", "tab:red"), strict=True)
        ):
            axes.plot(grid, curves[:, j], "o-", color=colour, markersize=3, label=quantity)
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
        sys.exit("usage: python -m benchmarks.one_at_a_time FILE.png [CONDITION=VALUE ...]")
    chosen = (argument.split("=") for argument in sys.argv[2:])
    main(Path(sys.argv[1]), {name: float(value) for name, value in chosen})
