"""The same samples given to SALib and OpenTURNS: how far values differ, and what each takes.

`python -m benchmarks.sensitivity.rivals` prints the page `docs/measurements/rivals.md`. Each is
asked for all that it says of one output with its intervals, as it makes them by default, and ours
of designs for these, without what the service keeps beside them to tell how stable a ranking is
(`WITH_ALL`, in lines of their own). Of times, in processor time, the least of `REPEATS` counts.
Where another program's value has another definition, what it is made of is compared instead.
"""

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import DEFAULT_SAMPLING, unit_rows
from analysis.given.measures.hdmr import PIECES
from analysis.given.measures.measure import MEASURES
from analysis.given.measures.pawn import pawn
from analysis.sensitivity.estimators import Estimator, ShapleyEffects, estimator_class
from analysis.sensitivity.estimators.weightings import FIRST, WEIGHTINGS
from benchmarks.machine import describe_machine

Array = NDArray[np.float64]

FACTORS = 6
#: Rows of a sample, and of designs also of a longer one.
ROWS, MANY_ROWS = 512, 8192
REPEATS = 5
#: What has taken so many seconds is not repeated.
LONG = 2.0
LEVEL = 0.9
SEED = 1000
#: How many weightings of rows estimators keep: for values alone, for intervals, and all.
VALUES, WITH_INTERVALS, WITH_ALL = 1, FIRST, WEIGHTINGS
_AND_ALL = ", and 200 replicates, which tell how stable rankings are"


@dataclass(frozen=True, kw_only=True)
class Line:
    """One program's answer beside ours, to the same runs."""

    index: str
    program: str
    rows: int = ROWS
    #: Each does its work and returns what is compared.
    ours: Callable[[], Array]
    #: None if it is compared in another line.
    theirs: Callable[[], Array] | None = None
    #: What takes its time, if that is not `theirs`.
    timed: Callable[[], Array] | None = None
    note: str = ""


def g_function(points: Array) -> Array:
    """Return Sobol's g of points (..., factors), of which each matters less than the one before."""
    weights = np.arange(points.shape[-1], dtype=np.float64)
    found: Array = np.prod((np.abs(4.0 * points - 2.0) + weights) / (1.0 + weights), axis=-1)
    return found


def lines() -> Iterator[Line]:
    """Yield all comparisons."""
    yield from _designed(ROWS)
    yield from _designed(MANY_ROWS)
    yield from _given()


def _designed(rows: int) -> Iterator[Line]:
    from SALib.analyze import radial_ee as salib_radial
    from SALib.analyze import shapley as salib_shapley
    from SALib.analyze import sobol as salib_sobol

    names = [f"x{i}" for i in range(FACTORS)]
    problem = {"num_vars": FACTORS, "names": names, "bounds": [[0.0, 1.0]] * FACTORS}
    points = _points("saltelli", rows)
    y = g_function(points)
    # Their order in a row: A, A with a column of B for every factor, B.
    in_order = y[:, [0, *range(2, 2 + FACTORS), 1]].ravel()

    def salib() -> Array:
        with _quiet():
            found = salib_sobol.analyze(problem, in_order, calc_second_order=False, seed=1)
        return np.asarray(found["ST"])

    for kept, note in ((WITH_INTERVALS, "; its S centres on another mean"), (WITH_ALL, _AND_ALL)):
        yield Line(
            index="S, ST",
            program="SALib",
            rows=rows,
            ours=partial(lambda kept: _indices("saltelli", y, kept)["total_order"], kept),
            theirs=salib,
            note="ST" + note,
        )
    import openturns as ot

    ot.ResourceMap.SetAsUnsignedInteger("TBB-ThreadsNumber", 1)
    blocks = np.concatenate([points[:, i] for i in range(2 + FACTORS)])
    outputs = np.concatenate([y[:, i] for i in range(2 + FACTORS)])[:, None]
    variance = y[:, :2].var()

    def openturns() -> Array:
        found = ot.JansenSensitivityAlgorithm(ot.Sample(blocks), ot.Sample(outputs), rows)
        found.getFirstOrderIndicesInterval(), found.getTotalOrderIndicesInterval()
        # It divides squares by 2 n - 1, and by the variance of A alone.
        scale = (1.0 - 0.5 / rows) * y[:, 0].var(ddof=1) / variance
        scaled: Array = np.array(found.getTotalOrderIndices()) * scale
        return scaled

    yield Line(
        index="S, ST",
        program="OpenTURNS",
        rows=rows,
        ours=lambda: _indices("saltelli", y, WITH_INTERVALS)["total_order"],
        theirs=openturns,
        note="ST (Jansen) in shares of the variance of A and B, as ours",
    )
    radial = _points("morris", rows)
    of_radial = g_function(radial)

    def salib_effects() -> Array:
        flat = radial.reshape(-1, FACTORS)
        found = salib_radial.analyze(problem, flat, of_radial.ravel(), sample_sets=rows, seed=1)
        return np.stack([found["mu"], found["mu_star"], found["sigma"]])

    def our_effects(kept: int) -> Array:
        found = _indices("morris", of_radial, kept)
        return np.stack([found["mu"], found["mu_star"], found["sigma"]])

    for kept, note in ((WITH_INTERVALS, "; theirs of mu* only"), (WITH_ALL, _AND_ALL)):
        yield Line(
            index="mu, mu*, sigma",
            program="SALib",
            rows=rows,
            ours=partial(our_effects, kept),
            theirs=salib_effects,
            note="with intervals of all three" + note,
        )
    ordered = _points("shapley", rows)
    shared = g_function(ordered)
    order = [0, *range(FACTORS, 0, -1)]
    trajectory = ordered[:, order].reshape(-1, FACTORS)

    def salib_effects_of_shapley() -> Array:
        found = salib_shapley.analyze(problem, trajectory, shared[:, order].ravel())
        return np.asarray(found["shapley_normalized"])

    for kind, kept, note in (
        (ShapleyEffects, VALUES, "values alone; theirs with intervals"),
        (ShapleyEffects, WITH_INTERVALS, "with intervals, as theirs"),
        (estimator_class("shapley"), WITH_ALL, "with full and independent indices" + _AND_ALL),
    ):
        yield Line(
            index="Shapley effects",
            program="SALib",
            rows=rows,
            ours=partial(
                lambda kind, kept: _indices("shapley", shared, kept, kind)["shapley"], kind, kept
            ),
            theirs=salib_effects_of_shapley,
            note=note,
        )


def _given() -> Iterator[Line]:
    from SALib.analyze import delta, rbd_fast
    from SALib.analyze import hdmr as salib_hdmr
    from SALib.analyze import pawn as salib_pawn

    names = [f"x{i}" for i in range(FACTORS)]
    problem = {"num_vars": FACTORS, "names": names, "bounds": [[0.0, 1.0]] * FACTORS}
    x = np.random.default_rng(SEED).random((ROWS, FACTORS))
    y = g_function(x)
    by_name = {measure.name: measure for measure in MEASURES}

    def ours(name: str) -> Callable[[], Array]:
        return lambda: by_name[name].estimate(x, y, LEVEL, np.random.default_rng(1)).value

    def salib(analyze: Callable[[], Any], key: str) -> Callable[[], Array]:
        def found() -> Array:
            with _quiet():
                return np.asarray(analyze()[key], dtype=np.float64)[:FACTORS]

        return found

    yield Line(
        index="RBD-FAST",
        program="SALib",
        ours=ours("rbd_fast"),
        theirs=salib(lambda: rbd_fast.analyze(problem, x, y, seed=1), "S1"),
    )
    ranks = np.argsort(np.argsort(x, axis=0), axis=0).astype(np.float64)
    yield Line(
        index="PAWN",
        program="SALib",
        ours=lambda: pawn(x, y),
        theirs=salib(lambda: salib_pawn.analyze(problem, ranks, y, S=10), "median"),
        note="without intervals, which SALib has none of",
    )

    power = 2.0 / (7.0 + np.tanh((1500.0 - ROWS) / 500.0))
    edges = np.linspace(0, ROWS, int(np.ceil(ROWS**power)) + 1)
    grid = np.linspace(y.min(), y.max(), 100)
    yield Line(
        index="delta",
        program="SALib",
        ours=ours("delta"),
        theirs=lambda: np.array([delta.calc_delta(y, grid, column, edges) for column in x.T]),
        timed=salib(
            lambda: delta.analyze(problem, x, y, num_resamples=16, method="delta", seed=1),
            "delta_raw",
        ),
        note="before their bias is taken off; 16 samples drawn, by theirs in each of three ways",
    )
    yield Line(
        index="HDMR",
        program="SALib",
        ours=ours("hdmr"),
        timed=salib(lambda: salib_hdmr.analyze(problem, x, y, maxorder=1, m=PIECES, K=20), "S"),
        note="with intervals; theirs holds what chance fits",
    )
    yield Line(
        index="R2-HSIC", program="OpenTURNS", ours=ours("hsic"), theirs=_openturns_hsic(x, y)
    )


def _openturns_hsic(x: Array, y: Array) -> Callable[[], Array]:
    def found() -> Array:
        import openturns as ot

        kernels = []
        for column in (*x.T, y):
            kernel = ot.SquaredExponential(1)
            kernel.setScale([float(column.std(ddof=1))])
            kernels.append(kernel)
        one = ot.HSICEstimatorGlobalSensitivity(
            kernels, ot.Sample(x), ot.Sample(y[:, None]), ot.HSICUStat()
        )
        one.getPValuesAsymptotic()
        return np.array(one.getR2HSICIndices())

    return found


def _points(method: str, rows: int) -> Array:
    return unit_rows(method, DEFAULT_SAMPLING, SEED, range(rows), FACTORS)


def _indices(
    method: str, y: Array, kept: int, kind: type[Estimator] | None = None
) -> dict[str, Array]:
    """Return the indices of rows (rows, width) by our estimators with so many weightings."""
    estimator: Estimator = (kind or estimator_class(method))(
        sampling=DEFAULT_SAMPLING, seed=SEED, factors=FACTORS, outputs=1, weightings=kept
    )
    estimator.add_rows(range(len(y)), y[..., None])
    return {name: found.value[0] for name, found in estimator.indices(LEVEL).items()}


def _taken(work: Callable[[], Array]) -> tuple[float, Array]:
    """Return the least processor time of a work, and what it returns."""
    times: list[float] = []
    while len(times) < REPEATS and sum(times) < LONG:
        started = time.process_time()
        found = work()
        times.append(time.process_time() - started)
    return min(times), found


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what SALib warns of to itself."""
    wording = warnings.formatwarning
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    warnings.formatwarning = wording


def main() -> None:
    """Print the table."""
    print(describe_machine())
    print(f"\nSobol's g of {FACTORS} factors, one output, `{DEFAULT_SAMPLING}` or random\n")
    print("| Index | Beside | Rows | Largest difference | Ours | Theirs | Times | Remark |")
    print("|---|---|---|---|---|---|---|---|")
    for line in lines():
        own, value = _taken(line.ours)
        work = line.timed or line.theirs
        assert work is not None
        other, _ = _taken(work)
        apart = "" if line.theirs is None else f"{np.max(np.abs(value - line.theirs())):.1e}"
        print(
            f"| {line.index} | {line.program} | {line.rows} | {apart} | {1e3 * own:.1f} ms | "
            f"{1e3 * other:.1f} ms | {other / own:.2g} | {line.note} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
