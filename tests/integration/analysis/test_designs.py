"""Rows of every design are the same in another process."""

import subprocess
import sys
from itertools import product

import pytest

from analysis.designs import METHODS, SAMPLINGS, unit_row

EVERY_DESIGN = list(product(METHODS, SAMPLINGS))
ROWS = [3, 1030, 49, 0, 50, 1023, 1024]


@pytest.fixture(scope="module")
def fresh() -> dict[str, str]:
    """Some rows of every design from another process, in rising order: hexadecimal by its name."""
    script = (
        "from analysis.designs import unit_row\n"
        f"for design in {EVERY_DESIGN!r}:\n"
        f"    rows = [unit_row(*design, 5, row, 3).tobytes().hex() for row in {sorted(ROWS)}]\n"
        "    print(*design, *rows)\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    lines = (line.split(" ", 2) for line in run.stdout.splitlines())
    return {f"{method} {sampling}": rows for method, sampling, rows in lines}


@pytest.mark.parametrize(("method", "sampling"), EVERY_DESIGN)
def test_a_row_depends_on_no_other_row(method: str, sampling: str, fresh: dict[str, str]) -> None:
    """Asking for rows in another order, or from a fresh process, changes no bit."""
    here = {row: unit_row(method, sampling, 5, row, 3).tobytes().hex() for row in ROWS}
    assert fresh[f"{method} {sampling}"].split() == [here[row] for row in sorted(ROWS)]
