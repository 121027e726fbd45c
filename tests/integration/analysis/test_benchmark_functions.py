"""The closed forms that `make bench-analysis` compares with are those of its functions."""

import numpy as np
import pytest
from scipy.stats import sobol_indices, uniform

from tests.testbed.functions.scalar import FACTORS, KNOWN


@pytest.mark.parametrize("name", KNOWN)
def test_closed_forms_are_what_scipy_finds_with_many_points(name: str) -> None:
    known = KNOWN[name]
    found = sobol_indices(
        func=lambda x: known.function(x.T)[None],
        n=2**15,
        dists=[uniform()] * FACTORS,
        rng=np.random.default_rng(3),
    )
    tolerance = 0.02 if name == "dummies only" else 0.004
    np.testing.assert_allclose(found.first_order.ravel(), known.first, atol=tolerance)
    np.testing.assert_allclose(found.total_order.ravel(), known.total, atol=tolerance)
