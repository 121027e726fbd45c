"""Figures drawn in less time: the tests in a browser look at whole ones."""

from collections.abc import Iterator

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure


@pytest.fixture(scope="module")
def without_layout() -> Iterator[None]:
    """Leave panels where they are: finding room for their labels takes most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "set_layout_engine", lambda figure, layout: None)
        # Letters as text, not as outlines.
        patch.setitem(mpl.rcParams, "svg.fonttype", "none")
        yield
