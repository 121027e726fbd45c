"""A coordinator, an analysis and workers on bad machines, each restarted when it dies."""

import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from signal import Signals

from tests.testbed.coordinators.postgresql import free_port
from tests.testbed.fleet import warm
from tests.testbed.fleet.bad_network import BadNetwork

HERE = Path(__file__).parent
TOKEN = "token-of-the-chaos"
LEASE_SECONDS = 2.0
#: Enough of them that hosts meet.
SHARE = "0.05"
#: Seconds for what takes two on a machine with nothing else to do.
PATIENCE = 200.0
_AWAY = "the database is away or full"


class BadLab:
    """What a study needs, on one machine, with everything it writes in one folder.

    Args:
        folder: an empty one.
        database: the coordinator's.
        seed: of what the network does.
    """

    def __init__(self, folder: Path, database: str, seed: int) -> None:
        self.folder = folder
        self.database = database
        (folder / "trouble").mkdir()
        #: Any number of them may serve one PostgreSQL; whoever works asks now one, now another.
        self.coordinators = ["coordinator"]
        if not database.startswith("sqlite"):
            self.coordinators.append("coordinator-2")
        ports = [free_port() for _ in self.coordinators]
        self.url = f"http://127.0.0.1:{ports[0]}"
        self.network = BadNetwork(ports, seed)
        self.environment = os.environ | {
            "REHYB_TOKEN": TOKEN,
            "REHYB_URL": self.network.url,
            "REHYB_DATABASE_URL": database,
            "REHYB_LEASE_SECONDS": str(LEASE_SECONDS),
            "REHYB_RECOMPUTE_SHARE": SHARE,
            "TROUBLE": str(folder / "trouble"),
        }
        self.processes: dict[str, subprocess.Popen[bytes] | warm.Process] = {}
        self._commands: dict[str, tuple[str, ...]] = {}
        #: Settings of single processes, beside those of all.
        self.settings: dict[str, dict[str, str]] = {}
        for name, port in zip(self.coordinators, ports, strict=True):
            (folder / f"{name}.log").touch()
            self.add(name, str(HERE / "bad_coordinator.py"), REHYB_PORT=str(port))
            self.until(lambda name=name: re.search("^listening on ", self.log(name), re.M))
        self.add("analysis", "rehyb", "analysis")

    @property
    def workers(self) -> list[str]:
        """Names of the workers."""
        return [name for name in self._commands if name.startswith("worker")]

    def add(self, name: str, *command: str, **settings: str) -> None:
        """Start a process, which is to be started again whenever it has died."""
        self._commands[name] = command
        self.settings[name] = settings
        self.revive()

    def add_worker(self, name: str, **settings: str) -> None:
        """Start a worker on a machine of its own."""
        spool = str(self.folder / f"spool-{name}")
        limits = ["--processes", "1", "--instance-seconds", "4", "--spool", spool]
        self.add(name, str(HERE / "saboteur.py"), *limits, MACHINE=f"machine-of-{name}", **settings)

    def revive(self) -> None:
        """Start what has died."""
        for name, command in self._commands.items():
            process = self.processes.get(name)
            if process is None or process.poll() is not None:
                environment = self.environment | self.settings[name]
                log = self.folder / f"{name}.log"
                if name.startswith("worker"):
                    self.processes[name] = _started(command, environment, log)
                else:
                    self.processes[name] = warm.Process(*command, environment=environment, out=log)

    def start_a_second_coordinator(self) -> str:
        """Return what it says before it gives up."""
        ended = subprocess.run(
            [sys.executable, "-m", "rehyb", "coordinator"],
            env=self.environment | {"REHYB_PORT": "0"},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert ended.returncode == 1
        return ended.stderr

    def signal(self, name: str, number: Signals) -> None:
        """Send a signal to one process."""
        self.processes[name].send_signal(number)

    def log(self, name: str) -> str:
        """Return what a process has written so far."""
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def failures(self) -> list[str]:
        """Return at what a coordinator failed, in its own words; of a database away a line."""
        lines = [line for name in self.coordinators for line in self.log(name).splitlines()]
        said = [json.loads(line) for line in lines if '"ex' in line or _AWAY in line]
        told = [e.get("exception", e["event"] if _AWAY in e["event"] else "") for e in said]
        return [words for words in told if words]

    def trouble(self) -> Counter[str]:
        """Return what has gone wrong within workers, counted."""
        marks = (self.folder / "trouble").iterdir()
        found = Counter(f"instance: {mark.name.split('-')[0]}" for mark in marks)
        found["spool: disk full"] = sum(
            self.log(name).count("results are kept in memory") for name in self.workers
        )
        return found

    def close(self) -> None:
        """End everything at once."""
        self.network.close()
        for process in self.processes.values():
            process.kill()
            process.wait()

    @staticmethod
    def until(ask: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Wait until the answer is true."""
        deadline = time.monotonic() + seconds
        while not ask():
            assert time.monotonic() < deadline, f"still not so after {seconds} s"
            time.sleep(0.05)


def _started(
    command: tuple[str, ...], environment: dict[str, str], log: Path
) -> subprocess.Popen[bytes]:
    with log.open("ab") as file:
        return subprocess.Popen(
            [sys.executable, *command],
            env=environment,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
