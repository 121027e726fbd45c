"""A small session of one trial as files, right until a test spoils it."""

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from tests.testbed.sessions.effects import GRAVITY, Arm
from tests.testbed.sessions.synthetic import mjcf

HEADER = "time,shoulder.position,elbow.position,elbow.velocity,elbow.effort"
ARM = Arm()


def rows(*, n: int = 2000) -> np.ndarray:
    """Return a clean trial of the arm, shape (n, 5)."""
    t = np.arange(n) / 200.0
    w = 2 * np.pi * 0.5
    q, v, a = 1.0 + 0.5 * np.sin(w * t), 0.5 * w * np.cos(w * t), -0.5 * w**2 * np.sin(w * t)
    q, v, a = q + 0.1 * np.sin(3 * w * t), v + 0.3 * w * np.cos(3 * w * t), a
    a = a - 0.9 * w**2 * np.sin(3 * w * t)
    effort = ARM.inertia * a + ARM.mass * GRAVITY * ARM.lever * np.cos(q - 0.4)
    effort += ARM.stiffness * (q - ARM.neutral) + ARM.damping * v
    return np.column_stack([t, np.full(n, -0.4), q, v, effort])


@lru_cache(maxsize=8)
def _lines(numbers: bytes, columns: int) -> str:
    """Return a table's lines of CSV; most sessions have the same."""
    table = np.frombuffer(numbers).reshape(-1, columns)
    return "\n".join(",".join(f"{x:.7g}" for x in row) for row in table)


class Folder:
    """A session's folder to spoil."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header, self.table = HEADER, rows()
        self.session = {
            "schema": 1,
            "model": "device.xml",
            "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}],
            "trials": [{"file": "a.csv"}],
        }
        self.model = mjcf(ARM)
        self.edit_text: Callable[[str], str] = lambda text: text

    def write(self) -> Path:
        lines = _lines(self.table.tobytes(), self.table.shape[1])
        text = f"{self.header}\n{lines}\n"
        (self.path / "a.csv").write_text(self.edit_text(text))
        (self.path / "device.xml").write_text(self.model)
        (self.path / "session.json").write_text(json.dumps(self.session))
        return self.path
