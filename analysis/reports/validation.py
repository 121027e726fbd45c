"""What a simulation gives beside what was measured or published, as one page."""

import base64
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.reports.html import render
from analysis.reports.tables import Grid


def write_validation(
    path: Path, rows: Sequence[Mapping[str, Any]], pictures: Sequence[Path]
) -> Path:
    """Write the page and return `path`.

    Args:
        path: of the page.
        rows: each with "quantity", "measured" (a number), "expected" (in words, with its source),
            "unit" and "agrees".
        pictures: PNG files, which become part of the page.

    Raises:
        OSError: a file cannot be read or written.
    """
    comparison = Grid(
        head=["quantity", "simulated", "unit", "expected", ""],
        rows=[
            [
                row["quantity"],
                row["measured"],
                row["unit"],
                row["expected"],
                "agrees" if row["agrees"] else "differs",
            ]
            for row in rows
        ],
    )
    page = render(
        "validation.html",
        title="Validation of the simulation",
        comparison=comparison,
        agreeing=sum(row["agrees"] for row in rows),
        pictures={picture.stem.replace("_", " "): _image(picture) for picture in pictures},
        version=version("rehyb"),
    )
    path.write_text(page, encoding="utf-8")
    return path


def _image(picture: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}"
