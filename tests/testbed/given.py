"""A small sample of the Ishigami function, and files of it."""

from pathlib import Path
from typing import Any

import numpy as np

ROWS = 88


def ishigami(u: Any) -> Any:
    x = (2.0 * u - 1.0) * np.pi
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def written(path: Path, table: Any, names: str = "a,b,c,y", cell: str = "{:.17g}") -> Path:
    separator = ";" if ";" in names else ","
    lines = [separator.join(cell.format(value) for value in row) for row in table]
    path.write_text("\n".join([names, *lines] if names != ";" else lines))
    return path
