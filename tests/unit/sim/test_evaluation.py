"""Evaluating one point of a model."""

import subprocess
import sys

import numpy as np
import pytest
from SALib.test_functions import Ishigami, Sobol_G

from sim.evaluation import G_COEFFICIENTS, evaluate, versions


def test_ishigami_is_that_of_an_independent_library() -> None:
    points = np.random.default_rng(1).uniform(-np.pi, np.pi, (20, 3))
    ours = [evaluate("ishigami", dict(zip(("x1", "x2", "x3"), p, strict=True))) for p in points]
    assert [e.outputs["y"] for e in ours] == pytest.approx(Ishigami.evaluate(points))


def test_sobol_g_is_that_of_an_independent_library() -> None:
    points = np.random.default_rng(2).uniform(0, 1, (20, 6))
    ours = [evaluate("sobol_g", {f"x{i + 1}": x for i, x in enumerate(p)}) for p in points]
    expected = Sobol_G.evaluate(points, a=np.array(G_COEFFICIENTS))
    assert [e.outputs["y"] for e in ours] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("model", "parameters", "message"),
    [
        ("knee", {}, "unknown model 'knee': expected one of elbow"),
        ("ishigami", {"x4": 0.0}, "ishigami has no factor 'x4'"),
        ("ishigami", {"x1": float("nan")}, "factor x1 must be finite"),
    ],
)
def test_a_point_that_does_not_exist_is_refused_in_a_sentence(
    model: str, parameters: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        evaluate(model, parameters)


def test_versions_name_what_decides_about_bits() -> None:
    assert {"rehyb", "mujoco", "numpy", "python", "platform"} == set(versions())


def test_describing_the_models_does_not_load_mujoco() -> None:
    code = "import sys, sim.models, sim.evaluation; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
