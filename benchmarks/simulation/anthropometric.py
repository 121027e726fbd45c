"""What it changes that factors of one arm go together: Table 1's box beside bodies as they are.

`python -m benchmarks.simulation.anthropometric [ROWS] [MODEL]` prints Shapley effects, full and
independent indices of three studies of the same seed: of Table 1's box, of the box with the
correlations of `sim.parameters.anthropometric`, and of these with the spreads of bodies.
"""

import sys
from multiprocessing import get_context

import numpy as np

from analysis.designs import DEFAULT_SAMPLING, instance_parameters
from analysis.designs.dependence import Dependence, copula
from analysis.designs.distributions import Distribution
from analysis.sensitivity.estimators import SYMBOLS, ShapleyEstimator
from sim.evaluation import evaluate
from sim.parameters.anthropometric import CORRELATIONS, STUDY, distribution
from sim.parameters.wearer import TABLE_1

SEED = 2026
OUTPUTS = ("stiffness_error", "stiffness_estimate", "stiffness_true")
NAMES = tuple(factor.name for factor in TABLE_1)
BOX = {name: Distribution.from_json(distribution(name, spread=False)) for name in NAMES}
BODIES = {f["name"]: Distribution.from_json(f["distribution"]) for f in STUDY["factors"]}
TOGETHER = Dependence(pairs=CORRELATIONS, kind=str(STUDY["correlation_kind"]))
#: Each study's distributions, and how its factors depend on each other.
STUDIES = {
    "Table 1's box": (BOX, None),
    "the box, correlated": (BOX, TOGETHER),
    "anthropometric": (BODIES, TOGETHER),
}


def run(asked: tuple[str, dict[str, float]]) -> list[float]:
    """Return the outputs of one point; nan if it failed."""
    found = evaluate(*asked).outputs or {}
    return [float(found.get(output, np.nan)) for output in OUTPUTS]


def main(rows: int = 128, model: str = "elbow_bushing") -> None:
    """Print one table for each output."""
    told = {}
    with get_context("spawn").Pool(1) as pool:
        for called, (shapes, dependence) in STUDIES.items():
            normals = (
                None if dependence is None else copula(dependence, NAMES, tuple(shapes.values()))
            )
            points = [
                point
                for row in range(rows)
                for point in instance_parameters(
                    "shapley", DEFAULT_SAMPLING, SEED, row, shapes, normals
                )
            ]
            values = np.array(pool.map(run, [(model, point) for point in points], chunksize=32))
            estimator = ShapleyEstimator(
                sampling=DEFAULT_SAMPLING, seed=SEED, factors=len(NAMES), outputs=len(OUTPUTS)
            )
            estimator.add_rows(range(rows), values.reshape(rows, -1, len(OUTPUTS)))
            failed = float(np.mean(np.isnan(values).any(axis=1)))
            told[called] = estimator.indices(0.9), estimator.moments(), failed
    print(f"{rows} rows of {len(NAMES) + 3} runs of {model} in each study, seed {SEED}.")
    for o, output in enumerate(OUTPUTS):
        print(f"\n## {output}\n")
        indices = ("shapley", "full_first_order", "independent_total_order")
        print(f"| study | factor | {' | '.join(SYMBOLS[index] for index in indices)} |")
        print("|---|---|---|---|---|")
        for called, (found, moments, failed) in told.items():
            print(
                f"| {called}: mean {moments.mean[o]:.2f}, sd {moments.sd[o]:.2f} Nm/rad, "
                f"{failed:.1%} failed | | | | |"
            )
            order = np.argsort(-found["shapley"].value[o])
            for f in order:
                cells = [
                    f"{found[i].value[o, f]:.2f} [{found[i].low[o, f]:.2f}, "
                    f"{found[i].high[o, f]:.2f}]"
                    for i in indices
                ]
                print(f"| | {NAMES[f]} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(*[kind(given) for kind, given in zip((int, str), sys.argv[1:], strict=False)])
