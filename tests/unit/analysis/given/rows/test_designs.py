"""Designs among rows that somebody else sampled: recognised, and told from drawn points."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.designs import unit_row
from analysis.given.answer import analyse, answer
from analysis.given.rows import layout
from analysis.given.rows.dependence import dependence
from analysis.given.rows.sample import choose
from analysis.given.rows.spread import in_parts, quasi_random, sharing_nothing
from analysis.given.table.reading import read_sheet
from analysis.given.table.refusals import GivenError
from analysis.sensitivity.estimators import MorrisEstimator, SaltelliEstimator
from analysis.sensitivity.estimators.weightings import WEIGHTINGS
from tests.testbed.given import ROWS, ishigami, written


def saltelli(rows: int, k: int = 3) -> Any:
    return np.stack([unit_row("saltelli", "owen_blocks", 4, row, k) for row in range(rows)])


def test_a_saltelli_design_of_any_order_is_recognised_and_estimated() -> None:
    design = saltelli(8)
    ours = SaltelliEstimator(sampling="latin_hypercube", seed=0, factors=3, outputs=1)
    ours.add_rows(range(8), ishigami(design.reshape(-1, 3)).reshape(8, 5, 1))
    for arranged in (design, design[:, [0, 2, 3, 4, 1]], design.swapaxes(0, 1)):
        x = arranged.reshape(-1, 3)
        found = layout.recognise(x)
        assert found is not None and found.method == "saltelli"
        indices = layout.indices(found, x, ishigami(x)[:, None], 0.9)
        for name, index in ours.indices(0.9).items():
            for end in ("value", "low", "high"):
                assert np.array_equal(getattr(indices[name], end), getattr(index, end))
        independent = x[found.independent].reshape(2, 8, 3)
        assert np.array_equal(independent, design[:, :2].swapaxes(0, 1))


@pytest.mark.parametrize("sampling", ["sobol", "trajectories", "random_trajectories"])
def test_a_morris_design_is_recognised_and_estimated(sampling: str) -> None:
    x = np.concatenate([unit_row("morris", sampling, 4, row, 3) for row in range(12)])
    found = layout.recognise(x)
    assert found is not None and found.method == "morris"
    y = np.stack([2.0 * x[:, 0] - x[:, 1], x[:, 2] ** 2], axis=1)
    reach = np.ptp(x, axis=0)
    effects = layout.indices(found, x, y, 0.9)["mu"].value
    assert effects[0] == pytest.approx([2.0 * reach[0], -reach[1], 0.0])
    ours = MorrisEstimator(sampling=sampling, seed=4, factors=3, outputs=2)
    ours.add_rows(range(12), y.reshape(12, 4, 2))
    assert effects == pytest.approx(ours.indices(0.9)["mu"].value * reach)


@pytest.mark.parametrize("rows", [40, 256])
def test_intervals_of_a_design_are_the_same_without_replicates_where_none_are_needed(
    rows: int,
) -> None:
    x = np.concatenate([unit_row("morris", "sobol", 4, row, 2) for row in range(rows)])
    y = (x[:, 0] * x[:, 1])[:, None]
    found = layout.recognise(x)
    assert found is not None
    ours = layout._indices(found, x, y, 0.9, WEIGHTINGS)
    for name, index in layout.indices(found, x, y, 0.9).items():
        assert not np.isnan(index.low).any()
        for end in ("value", "low", "high"):
            assert np.array_equal(getattr(index, end), getattr(ours[name], end))


def test_no_design_is_seen_in_random_points(points: Any) -> None:
    assert layout.recognise(points) is None
    for seed in range(20):
        rare = np.random.default_rng(seed).random((240, 2)) < 0.01
        assert layout.recognise(rare.astype(float)) is None
    x = saltelli(8).reshape(-1, 3)
    assert layout.recognise(np.roll(x, 1, axis=0)) is None


@pytest.mark.parametrize("method", ["saltelli", "morris"])
@pytest.mark.parametrize("cell", [1e6, np.nan])
def test_a_damaged_row_of_a_design_is_named_and_left_out(
    method: str, cell: float, tmp_path: Path
) -> None:
    x = np.stack([unit_row(method, "owen_blocks", 4, row, 3) for row in range(64)])
    width = x.shape[1]
    y = ishigami(x.reshape(-1, 3)).reshape(64, width)
    whole = np.delete(np.concatenate([x, y[..., None]], axis=2), 5, axis=0).reshape(-1, 4)
    x[5, 1, 2] = cell
    table = np.concatenate([x, y[..., None]], axis=2).reshape(-1, 4)
    found = analyse(written(tmp_path / "d.csv", table), ["y"])
    assert found["design"] == {"method": method, "rows": 63, "width": width}
    said = f"1 of its rows, which begin in row {5 * width + 1} of the table, do not fit"
    assert said in " ".join(found["remarks"])
    without = analyse(written(tmp_path / "w.csv", whole), ["y"])
    assert found["outputs"]["y"]["design"] == without["outputs"]["y"]["design"]


def test_of_a_design_only_points_that_share_nothing_count_as_a_sample(tmp_path: Path) -> None:
    x = saltelli(40).reshape(-1, 3)
    path = written(tmp_path / "design.csv", np.column_stack([x, ishigami(x)]))
    found = answer(choose(read_sheet(path), ["y"]))
    assert found["design"] == {"method": "saltelli", "rows": 40, "width": 5}
    assert found["measures"]["pawn"]["rows"] == 80
    assert set(found["outputs"]["y"]["design"]) == {"first_order", "total_order"}


def test_a_full_factorial_in_its_natural_order_has_no_related_factors(tmp_path: Path) -> None:
    grid = np.array(list(np.ndindex(5, 5, 5)), dtype=float)
    path = written(tmp_path / "grid.csv", np.column_stack([grid, grid.sum(axis=1)]))
    sample = choose(read_sheet(path), ["y"])
    assert sample.factors == ("a", "b", "c") and dependence(sample.factors, sample.x).remarks == []


@pytest.mark.parametrize(
    ("engine", "rows"), [(qmc.Sobol, 128), (qmc.Sobol, 250), (qmc.Halton, 256)]
)
def test_points_of_a_sequence_are_told_from_drawn_ones(engine: Any, rows: int) -> None:
    with warnings.catch_warnings(action="ignore"):
        points = engine(4, seed=3).random(rows)
    shuffled = np.random.default_rng(3).permutation(points)[: rows - rows // 40] ** 2
    assert quasi_random(points) and quasi_random(np.column_stack([shuffled, shuffled[:, 0]]))
    assert quasi_random(points.round(2)) and not quasi_random(np.square(shuffled).round(1))
    assert not quasi_random(qmc.LatinHypercube(4, seed=3).random(rows))
    assert not quasi_random(np.random.default_rng(3).random((rows, 4)))


def test_rounded_draws_and_grids_are_no_sequence() -> None:
    rng = np.random.default_rng(3)
    grid = rng.permutation(np.array(list(np.ndindex(40, 50)), dtype=float))
    for x in (grid, grid[:1500], np.column_stack([grid, rng.random(2000)])):
        assert not quasi_random(x)
    for seed in range(20):
        drawn = np.random.default_rng(seed).random((256, 4))
        assert not quasi_random(drawn.round(2)) and not quasi_random(np.floor(40.0 * drawn))


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_points_of_a_sequence_are_told_also_of_factors_that_all_depend_on_each_other(
    order: list[int],
) -> None:
    correlation = np.array([[1.0, 0.6, 0.5], [0.6, 1.0, 0.7], [0.5, 0.7, 1.0]])
    even = np.concatenate(
        [unit_row("sample", "owen_blocks", 4, row, 3, correlation) for row in range(512)]
    )
    assert quasi_random(even[:, order])
    drawn = np.random.default_rng(3).multivariate_normal(np.zeros(3), correlation, 512)
    assert not quasi_random(drawn[:, order])
    # A dependence that is no Gaussian copula's leaves nothing to judge by.
    bent = np.random.default_rng(3).random((512, 1))
    assert not quasi_random(np.column_stack([bent, np.sin(9.0 * bent), bent**2]))


@pytest.mark.parametrize(("optimization", "told"), [(None, True), ("random-cd", False)])
def test_of_a_latin_hypercube_rbd_fast_is_told_unless_it_was_optimised(
    optimization: Any, told: bool, tmp_path: Path
) -> None:
    """It was said to be Sobol's or Halton's, and the page that no Latin hypercube is affected."""
    x = qmc.LatinHypercube(3, rng=np.random.default_rng(1), optimization=optimization).random(128)
    found = analyse(written(tmp_path / "l.csv", np.column_stack([x, ishigami(x)])), ["y"])
    assert (found["outputs"]["y"]["measures"]["rbd_fast"]["a"]["value"] is not None) == told
    why = [one for one in found["remarks"] if "or of a Latin hypercube that was optimised" in one]
    assert len(why) == (not told)


def test_of_sobol_points_rbd_fast_is_withheld_and_why_is_said(tmp_path: Path) -> None:
    x = qmc.Sobol(3, seed=2).random(64)
    found = analyse(written(tmp_path / "s.csv", np.column_stack([x, ishigami(x)])), ["y"])
    of_y = found["outputs"]["y"]["measures"]
    assert of_y["rbd_fast"]["a"] == {"value": None, "low": None, "high": None}
    assert of_y["delta"]["a"]["value"] > 0.0
    assert "rbd_fast is withheld" in " ".join(found["remarks"])


def test_copies_of_rows_tell_nothing_new(tmp_path: Path, table: Any) -> None:
    sample = choose(read_sheet(written(tmp_path / "c.csv", np.tile(table, (3, 1)))), ["y"])
    assert np.array_equal(sample.x, table[:, :3])
    assert f"{2 * ROWS} of {3 * ROWS} rows are exact copies" in sample.remarks[0]
    holes = np.vstack([table, np.full((3, 4), np.nan)])
    sample = choose(read_sheet(written(tmp_path / "c.csv", holes)), ["y"])
    assert (
        "copies" not in sample.remarks[0]
        and f"3 of {ROWS + 3} rows lack a cell" in sample.remarks[0]
    )
    with pytest.raises(GivenError, match="it has 40 different rows, and not the 64"):
        choose(read_sheet(written(tmp_path / "c.csv", np.tile(table[:40], (3, 1)))), ["y"])


def test_equal_rows_of_few_values_are_no_copies(tmp_path: Path) -> None:
    x = np.random.default_rng(4).integers(0, 3, (80, 2)).astype(float)
    sample = choose(read_sheet(written(tmp_path / "d.csv", x, "a,y")), ["y"])
    assert len(sample.x) == 80


def test_parts_of_a_design_are_seen_in_any_order_and_thinned(tmp_path: Path) -> None:
    x = np.random.default_rng(6).permutation(saltelli(80).reshape(-1, 3))[:-3]
    assert in_parts(x) > 200
    apart = x[sharing_nothing(x)]
    assert all(len(np.unique(column)) == len(apart) for column in apart.T)
    found = answer(
        choose(read_sheet(written(tmp_path / "p.csv", np.column_stack([x, ishigami(x)]))), ["y"])
    )
    assert "give every line of it, in its order" in " ".join(found["remarks"])
    assert found["measures"]["pawn"]["rows"] == len(apart)


def test_drawn_rounded_and_crossed_points_are_no_parts_of_a_design(points: Any) -> None:
    grid = np.array(list(np.ndindex(5, 5, 5)), dtype=float)
    for x in (points, points.round(1), grid):
        assert in_parts(x) == 0


def test_a_column_that_counts_the_rows_hides_no_design(tmp_path: Path) -> None:
    x = saltelli(40).reshape(-1, 3)
    table = np.column_stack([np.arange(200.0), x, ishigami(x)])
    path = written(tmp_path / "numbered.csv", table, "run,a,b,c,y")
    found = analyse(path, ["y"])
    assert found["design"] == {"method": "saltelli", "rows": 40, "width": 5}
    assert "Columns that only count the rows are left out: run." in found["remarks"][0]
    named = choose(read_sheet(path), ["y"], ["run", "a"])
    assert named.factors == ("run", "a") and named.remarks == ()
    sweep = written(tmp_path / "sweep.csv", table[:, [0, 4]], "force,y")
    assert choose(read_sheet(sweep), ["y"]).factors == ("force",)
    table[:, 1] = 20.0
    still = written(tmp_path / "still.csv", table[:, [0, 1, 4]], "force,room,y")
    assert choose(read_sheet(still), ["y"]).factors == ("force",)


def test_a_morris_design_on_a_grid_is_named_in_any_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    x = np.concatenate([unit_row("morris", "trajectories", 4, row, 5) for row in range(40)])
    x = rng.permutation(x)
    assert len(np.unique(x[:, 0].round(9))) == 4 and in_parts(x) > 200
    drawn = rng.integers(0, 4, (240, 5)).astype(float)
    tied = drawn.copy()
    tied[:, 1] = np.clip(tied[:, 0] + rng.integers(-1, 2, 240), 0, 3)
    assert in_parts(drawn) == in_parts(tied) == 0


def with_few(x: Any, levels: int) -> Any:
    """Return points whose second factor has few values."""
    return np.column_stack([x[:, 0], np.floor(levels * x[:, 1]), x[:, 2]])


@pytest.mark.parametrize("levels", [2, 3])
def test_a_saltelli_design_is_recognised_though_a_factor_of_few_values_makes_points_meet(
    levels: int, tmp_path: Path
) -> None:
    design = saltelli(64)[:, [0, 2, 3, 4, 1]]
    x = with_few(design.reshape(-1, 3), levels)
    assert len(np.unique(x, axis=0)) < len(x)
    found = analyse(written(tmp_path / "s.csv", np.column_stack([x, x.sum(axis=1)])), ["y"])
    assert found["design"] == {"method": "saltelli", "rows": 64, "width": 5}
    assert found["rows_used"] == 320 and "copies" not in " ".join(found["remarks"])


@pytest.mark.parametrize("levels", [4, 6, 8])
@pytest.mark.parametrize("k", [3, 4])
def test_a_morris_design_is_recognised_though_its_walks_meet(
    levels: int, k: int, tmp_path: Path
) -> None:
    rng, rows = np.random.default_rng(1), []
    for _ in range(40):
        point, step = rng.integers(0, levels // 2, k), levels // 2
        rows.append(point)
        for factor in rng.permutation(k):
            point = point + step * (np.arange(k) == factor)
            rows.append(point)
    x = np.array(rows, dtype=float)
    assert len(np.unique(x, axis=0)) < len(x)
    table = np.column_stack([x, x @ (1.0 + np.arange(k))])
    found = analyse(written(tmp_path / "m.csv", table, ",".join("abcd"[:k]) + ",y"), ["y"])
    assert found["design"] == {"method": "morris", "rows": 40, "width": k + 1}


def test_a_design_that_stands_there_twice_counts_once(tmp_path: Path) -> None:
    x = with_few(saltelli(64).reshape(-1, 3), 2)
    table = np.tile(np.column_stack([x, x.sum(axis=1)]), (2, 1))
    found = analyse(written(tmp_path / "twice.csv", table), ["y"])
    assert found["design"] == {"method": "saltelli", "rows": 64, "width": 5}


@pytest.mark.parametrize("levels", [2, 3])
def test_parts_of_a_design_with_a_factor_of_few_values_are_named_in_any_order(
    levels: int, tmp_path: Path
) -> None:
    x = np.random.default_rng(6).permutation(with_few(saltelli(128).reshape(-1, 3), levels))
    found = analyse(written(tmp_path / "p.csv", np.column_stack([x, x.sum(axis=1)])), ["y"])
    assert found["design"] is None
    assert "as parts of a Saltelli or Morris design do" in " ".join(found["remarks"])


def test_drawn_tables_with_factors_of_few_values_are_no_parts_of_a_design() -> None:
    for seed in range(20):
        drawn = np.random.default_rng(seed).random((300, 4))
        for levels in ((2, 0, 0, 0), (2, 3, 0, 0), (2, 2, 5, 0), (2, 75, 0, 0)):
            x = np.where(np.array(levels) > 0, np.floor(drawn * levels), drawn)
            assert in_parts(x) == 0


@pytest.mark.parametrize(("rows", "believed"), [(64, False), (128, True)])
def test_of_a_design_of_few_rows_it_is_said_that_intervals_are_not_to_be_believed(
    rows: int, believed: bool
) -> None:
    """64 rows of a stranger's held 0.66 to 0.86."""
    found = layout.recognise(saltelli(rows).reshape(-1, 3))
    assert found is not None
    assert found.sentence.endswith("not to be believed.") != believed


@pytest.mark.parametrize(("offset", "said"), [(0.0, 0), (1e12, 1), (1e16, 1)])
def test_of_an_output_that_an_offset_hides_it_is_said_that_its_rounding_is_left(
    offset: float, said: int, tmp_path: Path
) -> None:
    x = np.random.default_rng(1).random((200, 2))
    y = offset + 1e-3 * (x[:, 0] + (offset > 1e15) * 4e3 * x[:, 1])
    remarks = analyse(written(tmp_path / "s.csv", np.column_stack([x, y]), "a,b,y"), ["y"])[
        "remarks"
    ]
    assert sum("take off what is the same" in remark for remark in remarks) == said
