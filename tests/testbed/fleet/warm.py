"""Coordinators and analyses as processes of their own, forked from one that has imported them.

A test kills and restarts them by the dozen, and what they import takes longer than all else that
they do. Tests of how they start begin them with `subprocess`, as everybody does.
"""

import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Mapping
from multiprocessing import get_context
from pathlib import Path

from rehyb import fleet

_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        "rehyb.cli",
        "server.run",
        "server.operations.study.result_log",
        "analysis.sensitivity.service",
        # Whoever draws up the first Sobol row imports it.
        "scipy.stats",
    ]
)


class Process:
    """A running command, used like `subprocess.Popen`.

    Args:
        command: a module, or the path of a script, and its arguments, as after `python -m`.
        environment: all of it.
        out, err: files that are appended to; errors join the output unless told otherwise.
    """

    def __init__(
        self, *command: str, environment: Mapping[str, str], out: Path, err: Path | None = None
    ) -> None:
        self._command = command
        self._process = _CONTEXT.Process(
            target=_run, args=(command, dict(environment), out, err or out), daemon=True
        )
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Its exit status, the negated signal that ended it, or None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Return its exit status; TimeoutExpired if it still runs."""
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self._command, timeout or 0.0)
        return self.returncode

    def send_signal(self, number: signal.Signals) -> None:
        if self.returncode is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class WarmFleet(fleet.LocalFleet):
    """A LocalFleet whose coordinator and analysis are forked; its workers are started as ever."""

    def _add(self, name: str, module: str, *arguments: str) -> fleet._Process:
        if module != "rehyb":
            return super()._add(name, module, *arguments)
        log = self.directory / "logs" / f"{name}.log"
        process = _Forked(name, [module, *arguments], self._environment, log)
        self._processes.append(process)
        return process


class _Forked(fleet._Process):
    def _started(self) -> Process:  # type: ignore[override]
        self._log.parent.mkdir(exist_ok=True)
        self._log.touch()
        self._log_start = self._log.stat().st_size
        return Process(*self._command, environment=self._environment, out=self._log)


def _run(command: tuple[str, ...], environment: dict[str, str], out: Path, err: Path) -> None:
    os.setsid()
    os.environ.clear()
    os.environ.update(environment)
    for stream, path in ((1, out), (2, err)):
        with path.open("ab") as file:
            os.dup2(file.fileno(), stream)
    sys.argv = list(command)
    if command[0].endswith(".py"):
        runpy.run_path(command[0], run_name="__main__")
    else:
        runpy.run_module(command[0], run_name="__main__", alter_sys=True)
