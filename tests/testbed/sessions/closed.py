"""The loop closed without the page, or its pictures, which take two thirds of the time."""

from pathlib import Path
from typing import Any

import pytest

from analysis.closeloop import loop
from analysis.closeloop.report import page


def closed_without_page(session: Path, out: Path) -> dict[str, Any]:
    """Close the loop on a session; return the report. The page is an empty file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "write_page", lambda path, _: path.touch())
        return loop.close_loop(session, out)


def closed_without_pictures(session: Path, out: Path) -> dict[str, Any]:
    """Close the loop on a session; return the report. The page has all its words."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "data_uri", lambda *_, **__: "data:,")
        return loop.close_loop(session, out)
