"""How often intervals of Shapley effects, and of indices of given samples, hold the truth.

`python -m benchmarks.sensitivity.dependent [STUDIES] [SAMPLES] [PROCESSES]` prints the page
`docs/measurements/dependent.md`. Truths are closed forms or quadrature (of `full_total_order` and
`independent_first_order` of functions that are not linear, none is known here). RBD-FAST and HDMR
are compared with S, HSIC with the mean of its values in samples of `HSIC_ROWS` rows; delta and
PAWN, which are biased, with the mean of their own values over all seeds, since their intervals say
where another sample of as many rows would put them. Seeds begin at 5000. What was set while looking
at results was set on seeds below 300 (how many cuts and resamples, which of both for which measure)
and from 300 to 719 (how often halves count what chance adds); seeds from 1000 to 1299 had been
reported before.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from analysis.designs import DEFAULT_SAMPLING, unit_row
from analysis.given.measures.hsic import r2_hsic
from analysis.given.measures.measure import MEASURES
from analysis.sensitivity.estimators import SYMBOLS, ShapleyEstimator
from tests.testbed.functions.dependent import ishigami, ishigami_of_dependent, linear, truths

Array = NDArray[np.float64]

FIRST_SEED = 5000
LEVEL = 0.9
#: Rows of a study, and rows of a sample.
SIZES = {"study": (128, 512), "sample": (128, 512)}
CORRELATION = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0], [0.5, 0.0, 1.0]])
WEIGHTS = np.array([1.0, 2.0, 3.0])
#: Weights of Sobol's g, on which nothing was set.
G_WEIGHTS = np.array([0.0, 1.0, 3.0])
#: S of Ishigami's function (Ishigami and Homma 1990), of Sobol's g (Sobol 1993), and of a factor
#: that does nothing.
_OF_G = 1.0 / (3.0 * (1.0 + G_WEIGHTS) ** 2)
FIRST = {
    "ishigami": np.array([0.3139, 0.4424, 0.0, 0.0]),
    "g": np.append(_OF_G / (np.prod(1.0 + _OF_G) - 1.0), 0.0),
}
HSIC_ROWS, HSIC_SAMPLES = 2000, 20
_FUNCTIONS = ("linear", "ishigami")

#: By (what, index, rows): values, low and high ends, shape (factors,) each.
Found = dict[tuple[str, str, int], tuple[Array, Array, Array]]


def study(seed: int, rows: int) -> Found:
    """Return the indices of one study of both functions."""
    points = np.stack(
        [unit_row("shapley", DEFAULT_SAMPLING, seed, row, 3, CORRELATION) for row in range(rows)]
    )
    outputs = np.stack([ndtri(points) @ WEIGHTS, ishigami(points)], axis=-1)
    estimator = ShapleyEstimator(sampling=DEFAULT_SAMPLING, seed=seed, factors=3, outputs=2)
    estimator.add_rows(range(rows), outputs)
    return {
        (name, index, rows): (found.value[o], found.low[o], found.high[o])
        for index, found in estimator.indices(LEVEL).items()
        for o, name in enumerate(_FUNCTIONS)
    }


def g_function(points: Array) -> Array:
    """Return Sobol's g of the first three of the factors."""
    parts = (np.abs(4.0 * points[..., :3] - 2.0) + G_WEIGHTS) / (1.0 + G_WEIGHTS)
    found: Array = parts.prod(axis=-1)
    return found


SAMPLED = {"ishigami": ishigami, "g": g_function}


def sample(seed: int, rows: int) -> Found:
    """Return the measures of a sample of both functions and a factor that does nothing."""
    x = np.random.default_rng([seed, rows]).random((rows, 4))
    found: Found = {}
    for name, function in SAMPLED.items():
        y = function(x)
        for measure in MEASURES:
            one = measure.estimate(x, y, LEVEL, np.random.default_rng(seed))
            found[name, measure.name, rows] = one.value, one.low, one.high
    return found


def one_seed(kind: str, rows: int, seed: int) -> Found:
    """Return what one study or one sample says."""
    return study(seed, rows) if kind == "study" else sample(seed, rows)


def main(studies: int = 300, samples: int = 300, processes: int = 1) -> None:
    """Print the tables, each as soon as it is known."""
    with ProcessPoolExecutor(processes) as pool:
        for kind, seeds in (("study", studies), ("sample", samples)):
            title = (
                "Shapley effects, full and independent indices, of correlated factors"
                if kind == "study"
                else "Measures of given samples of Ishigami's function, of Sobol's g, and a factor "
                "that does nothing"
            )
            print(f"\n## {title}: {seeds} seeds, 90 % intervals\n")
            print("| function | index | rows | held, by factor | mean width | rmse |")
            print("|---|---|---|---|---|---|", flush=True)
            for rows in SIZES[kind]:
                every = range(FIRST_SEED, FIRST_SEED + seeds)
                for line in lines(pool.map(partial(one_seed, kind, rows), every), kind):
                    print(line, flush=True)


def lines(results: Iterator[Found], kind: str) -> Iterator[str]:
    """Yield the lines of a table."""
    gathered: dict[tuple[str, str, int], list[tuple[Array, Array, Array]]] = defaultdict(list)
    for found in results:
        for key, entry in found.items():
            gathered[key].append(entry)
    for (name, index, rows), entries in sorted(gathered.items(), key=lambda item: item[0][2]):
        value, low, high = (np.array(part) for part in zip(*entries, strict=True))
        truth = _truth(kind, name, index, value)
        if truth is None:
            continue
        held = np.mean((low <= truth + 1e-12) & (high >= truth - 1e-12), axis=0)
        width, off = np.mean(high - low, axis=0), np.sqrt(np.mean((value - truth) ** 2, axis=0))
        cells = [" ".join(f"{share:.2f}" for share in held)]
        cells += [" ".join(f"{one:.3f}" for one in part) for part in (width, off)]
        print_name = SYMBOLS.get(index, index)
        yield f"| {name} | {print_name} | {rows} | {' | '.join(cells)} |"


def _truth(kind: str, name: str, index: str, value: Array) -> Array | None:
    if kind == "sample":
        if index in ("rbd_fast", "hdmr"):
            return FIRST[name]
        return _hsic(name) if index == "hsic" else value.mean(axis=0)
    known = truths(linear(WEIGHTS, CORRELATION) if name == "linear" else ishigami_of_dependent(0.5))
    if name == "linear":
        known["full_total_order"] = known["full_first_order"]
        known["independent_first_order"] = known["independent_total_order"]
    return known.get(index)


@lru_cache(maxsize=2)
def _hsic(name: str) -> Array:
    rng = np.random.default_rng(FIRST_SEED)
    drawn = (rng.random((HSIC_ROWS, 4)) for _ in range(HSIC_SAMPLES))
    return np.asarray(np.mean([r2_hsic(x, SAMPLED[name](x)) for x in drawn], axis=0))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
