"""Processes that simulate a bank's wearers, and whoever started them."""

import subprocess
import sys
from pathlib import Path

from models.processes import children
from tests.testbed.fleet.lab import until

BUILD = """
from analysis.interpretation.bank.population import default_population
from analysis.interpretation.bank.sampling import sample
print("begun", flush=True)
if __name__ == "__main__":
    sample(default_population(), 1, range(100_000), level="bushing", processes=2)
"""


def runs(pid: int) -> bool:
    """Whether a process is there, and no corpse that nobody has buried."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_simulators_leave_with_the_process_that_started_them(tmp_path: Path) -> None:
    script = tmp_path / "build.py"
    script.write_text(BUILD)
    with subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as build:
        assert build.stdout is not None
        try:
            # Its own, and one of each process, which has been told by then whose it is; two may
            # speak at once.
            said = ""
            while said.count("begun") < 3:
                line = build.stdout.readline()
                assert line, said
                said += line
            simulators = children(build.pid)
            assert len(simulators) >= 2
        finally:
            build.kill()
    until(lambda: not any(map(runs, simulators)))
