"""One thread of linear algebra a process."""

import subprocess
import sys

import pytest

from rehyb.threads import VARIABLE

#: What NumPy computes with in a process that a command has prepared.
THREADS = """
from rehyb.threads import limit_threads
limit_threads()
import numpy, threadpoolctl
print(*(pool["num_threads"] for pool in threadpoolctl.threadpool_info()))
"""


@pytest.mark.parametrize("asked", [None, "2"])
def test_numpy_takes_one_thread_unless_the_environment_says_otherwise(
    asked: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    if asked:
        monkeypatch.setenv(VARIABLE, asked)
    told = [sys.executable, "-c", THREADS]
    ran = subprocess.run(told, capture_output=True, text=True, check=True)
    assert set(ran.stdout.split()) == {asked or "1"}


@pytest.mark.parametrize("command", ["rehyb.cli", "worker.cli"])
def test_a_command_loads_no_numpy_before_it_says_how_many(command: str) -> None:
    loaded = f"import sys, {command}; print('numpy' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
