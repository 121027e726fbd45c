"""A spare machine installs little, and the parent process of a worker loads little."""

import subprocess
import sys

import pytest

HEAVY = ("mujoco", "numpy", "scipy", "sqlalchemy", "fastapi", "pydantic", "matplotlib", "server")


@pytest.mark.parametrize(
    "module", ["worker.cli", "worker.agent", "rehyb", "rehyb.client", "rehyb.cli"]
)
def test_importing_it_loads_nothing_heavy(module: str) -> None:
    script = f"import sys, {module}; print(*sorted(m.split('.')[0] for m in sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not set(loaded) & set(HEAVY)
