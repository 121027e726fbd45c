"""README, "Run it on several machines", as written: two loopback addresses, a fresh clone on each.

Only pip's work is not repeated: a link to the environment that runs the tests stands for it. The
coordinator takes a free port.
"""

import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest

ROOT = Path(__file__).parents[2]
SECTION = re.search(
    r"## Run it on several machines\n(.*?)\n## ", (ROOT / "README.md").read_text(), re.S
)
#: The coordinator's in the README, and here; the other machine speaks from 127.0.0.1.
WRITTEN, ADDRESS = "192.168.1.10", "127.0.0.2"


class Machine:
    """A folder with a clone and a home, and the processes started there."""

    def __init__(self, folder: Path) -> None:
        self.clone = folder / "rehyb"
        names = (".git", ".venv", ".*_cache", "__pycache__", "build", "demo")
        ignored = shutil.ignore_patterns(*names)
        shutil.copytree(ROOT, self.clone, ignore=ignored)
        (self.clone / ".venv").symlink_to(sys.prefix)
        self._environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith("REHYB_") and not name.lower().endswith("_proxy")
        } | {"PYTHONPATH": str(self.clone), "HOME": str(folder), "COLUMNS": "200"}
        self._running: list[subprocess.Popen[str]] = []

    def run(self, command: str) -> str:
        """Return what a command prints."""
        ran = subprocess.run(["bash", "-c", command], **self._how(), check=False, timeout=120)
        assert ran.returncode == 0, f"{command}\n{ran.stdout}\n{ran.stderr}"
        return str(ran.stdout)

    def start(self, command: str) -> "subprocess.Popen[str]":
        """Start a command that does not end."""
        line, _, last = command.rpartition("\n")
        process = subprocess.Popen(["bash", "-c", f"{line}\nexec {last}"], **self._how())
        self._running.append(process)
        return process

    def _how(self) -> "dict[str, object]":
        return {
            "cwd": self.clone,
            "env": self._environment,
            "stdout": subprocess.PIPE,
            "stderr": subprocess.PIPE,
            "text": True,
        }

    def switch_off(self) -> None:
        for process in self._running:
            process.terminate()
            process.communicate(timeout=60)


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[Machine, Machine]]:
    first, second = Machine(tmp_path / "first"), Machine(tmp_path / "second")
    yield first, second
    second.switch_off()
    first.switch_off()


def test_the_section_works_as_written(machines: tuple[Machine, Machine]) -> None:
    assert SECTION is not None
    install, up, work, look = (
        block.replace(WRITTEN, ADDRESS).strip()
        for block in re.findall(r"```sh\n(.*?)```", SECTION[1], re.S)
    )
    assert install.splitlines() == [
        "python3 -m venv .venv",
        ".venv/bin/pip install '.[server]'",
    ]
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "server" in extras["optional-dependencies"]
    coordinates, computes = machines

    coordinator = coordinates.start(f"{up} --port 0")
    assert coordinator.stdout is not None
    export = ""
    while "export" not in export:
        export = coordinator.stdout.readline()
        assert export, coordinator.communicate()[1]
    export = export.strip()
    written, doctor, worker = work.splitlines()
    assert re.sub(r"=\S+", "=", written) == re.sub(r"=\S+", "=", export)
    url = re.search(r"REHYB_URL=(\S+)", export)
    assert url is not None
    assert url[1].startswith(f"http://{ADDRESS}:")
    with pytest.raises(httpx2.ConnectError):
        httpx2.get(f"{url[1].replace(ADDRESS, '127.0.0.1')}/healthz", trust_env=False)

    findings = computes.run(f"{export}\n{doctor}")
    assert "failure" not in findings
    computes.start(f"{export}\n{worker}")
    commands = look.splitlines()
    deadline = time.monotonic() + 60.0
    while computes.run(f"{export}\n{commands[0]} --json").count('"id": ') < 2:
        assert time.monotonic() < deadline
    assert "trust" in computes.run(f"{export}\n{commands[0]}")
    study = ""
    for command in commands[1:]:
        printed = computes.run(f"{export}\n{command.replace(' ID', f' {study}')}")
        if "submit" in command:
            assert "400 instances" in printed
            study = printed.split()[0]
        elif "list" in command:
            assert study in printed and "try" in printed
        elif "progress" in command:
            assert printed.splitlines()[-1].startswith("complete: 400/400 results, 100/100 rows")
        else:
            assert "rows are complete" in printed
    listed = computes.run(f"{export}\n{commands[0]} --json")
    assert len(re.findall(r'"id": ', listed)) == 2
    assert sum(map(int, re.findall(r'"instances_done": (\d+)', listed))) == 400
