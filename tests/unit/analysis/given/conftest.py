"""A small sample of the Ishigami function, and what it tells."""

from typing import Any

import numpy as np
import pytest

from analysis.given.answer import analyse
from tests.testbed.given import ROWS, ishigami, written


@pytest.fixture(scope="module")
def points() -> Any:
    return np.random.default_rng(5).random((ROWS, 3))


@pytest.fixture(scope="module")
def table(points: Any) -> Any:
    return np.column_stack([points, ishigami(points)])


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory, table: Any) -> Any:
    path = written(tmp_path_factory.mktemp("given") / "runs.csv", table)
    return analyse(path, ["y"])
