"""A coordinator and the workers started for it, as processes of this machine."""

import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from rehyb import Client
from tests.testbed.fleet import warm

TOKEN = "token-of-the-worker-tests"
WORKER = Path(__file__).with_name("quick_worker.py")


def until(ask: Callable[[], object], seconds: float = 30.0) -> None:
    """Wait until the answer is true."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if ask():
            return
        time.sleep(0.02)
    raise AssertionError(f"still not so after {seconds} s")


class Lab:
    """A coordinator and the workers started for it, all in one folder.

    `settings`: variables of the environment of all of them.
    """

    def __init__(self, folder: Path, **settings: str) -> None:
        self.folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.environment = os.environ | {
            "REHYB_TOKEN": TOKEN,
            "REHYB_URL": f"http://127.0.0.1:{self.port}",
            "REHYB_PORT": str(self.port),
            "XDG_STATE_HOME": str(folder / "state"),
            "REHYB_DATABASE_URL": f"sqlite:///{folder}/lab.sqlite3",
            **settings,
        }
        self.client = Client(self.environment["REHYB_URL"], TOKEN)
        self.processes: list[subprocess.Popen[bytes] | warm.Process] = []
        self.coordinator = self.start_coordinator()

    def start_coordinator(self) -> warm.Process:
        log = self.folder / f"coordinator-{len(self.processes)}.log"
        log.touch()
        self.coordinator = warm.Process(
            "rehyb", "coordinator", environment=self.environment, out=log
        )
        self.processes.append(self.coordinator)
        until(lambda: re.search("^listening on ", log.read_text()))
        return self.coordinator

    def start_worker(self, *options: str) -> subprocess.Popen[bytes]:
        spool = str(self.folder / "spool")
        log = self.folder / f"worker-{len(self.processes)}.log"
        with log.open("wb") as file:
            process = subprocess.Popen(
                [sys.executable, WORKER, "--spool", spool, "--processes", "1", *options],
                env=self.environment,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.processes.append(process)
        return process

    def close(self) -> None:
        self.client.close()
        for process in self.processes:
            process.kill()
            process.wait()
