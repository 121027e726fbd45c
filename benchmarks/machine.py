"""What a figure was measured on."""

import os
from datetime import UTC, datetime
from pathlib import Path

from sim.evaluation import versions


def machine() -> str:
    """Return one line: processor, cores, platform, versions."""
    model = next(
        (
            line.split(":", 1)[1].strip()
            for line in _lines(Path("/proc/cpuinfo"))
            if line.startswith("model name")
        ),
        "unknown processor",
    )
    known = versions()
    return (
        f"{model}, {os.cpu_count()} cores, {known['platform']}, Python {known['python']}, "
        f"MuJoCo {known['mujoco']}"
    )


def describe_machine() -> str:
    """Return one line: the machine and the date."""
    return f"{machine()}, {datetime.now(UTC):%Y-%m-%d}"


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []
