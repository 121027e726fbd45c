"""`python -m rehyb` in a folder that holds programs of the user's own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from models.processes import python

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("name", ["sim", "analysis", "intake", "models"])
def test_a_program_of_the_user_s_is_not_taken_for_ours(tmp_path: Path, name: str) -> None:
    """It ended in a traceback: "'sim' is not a package" (a stranger's)."""
    (tmp_path / f"{name}.py").write_text("raise SystemExit('the user\\'s own ran')\n")
    command = [sys.executable, "-m", "rehyb", "close-loop", "missing", "--out", "out"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "own ran" not in done.stderr
    assert done.stderr.startswith("rehyb: missing") and "Traceback" not in done.stderr


@pytest.mark.parametrize("module", ["rehyb", "worker"])
def test_nor_by_what_is_started_for_a_fleet(
    tmp_path: Path, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`rehyb up` did not start, whose processes run where the user is (a stranger's)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("models", "server", "worker"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the user\\'s own ran')\n")
    done = subprocess.run(
        python("-m", module, "--help"), capture_output=True, text=True, check=False
    )
    assert "own ran" not in done.stderr and "Traceback" not in done.stderr
    assert done.returncode == 0 and "Usage: " in done.stdout
