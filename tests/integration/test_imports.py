"""A fresh Python that imports a room loads neither what the room must not know nor ballast."""

import subprocess
import sys

import pytest

#: A spare machine installs little, and the parent process of a worker loads little.
HEAVY = {"mujoco", "numpy", "scipy", "sqlalchemy", "fastapi", "pydantic", "matplotlib", "server"}


@pytest.mark.parametrize(
    ("module", "forbidden"),
    [
        ("rehyb", HEAVY),
        ("rehyb.client", HEAVY),
        ("rehyb.cli", HEAVY),
        ("worker.cli", HEAVY | {"analysis"}),
        ("worker.agent", HEAVY),
        (
            "server.run, server.operations.study.result_log",
            {"mujoco", "sim", "matplotlib", "worker", "pandas", "scipy.stats"},
        ),
        ("analysis.closeloop.code", {"mujoco", "numpy"}),
        ("analysis.interpretation.answer", {"scipy.signal", "scipy.stats", "sklearn"}),
        (
            "sim.assessment.assess, sim.evaluation",
            {"httpx2", "fastapi", "sqlalchemy", "analysis", "matplotlib", "scipy"},
        ),
    ],
)
def test_importing_a_room_does_not_load_what_it_must_not_know(
    module: str, forbidden: set[str]
) -> None:
    code = f"import sys, {module}; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(loaded) & forbidden == set()
