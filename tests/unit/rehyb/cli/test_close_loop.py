"""What closing a loop prints."""

from pathlib import Path
from typing import Any

import pytest

from analysis.closeloop.report.unexplained import OF_SIGNALS
from rehyb.cli.close_loop import _lines, naming_older
from rehyb.errors import Invalid


def report(floor: float | None = 0.02) -> dict[str, Any]:
    error = {"before": 0.5, "after": 0.1, "floor": floor, "unit": "Nm"}
    left = {"rms": 0.7, "rms_of": OF_SIGNALS, "unit": "Nm", "depends_on": ["elbow.velocity"]}
    return {
        "verdict": "unexplained",
        "effects": [],
        "error": {"holdout": {"elbow": error}},
        "impedance": {},
        "unexplained": {"elbow": left},
        "advice": [],
        "warnings": [],
    }


@pytest.mark.parametrize(("floor", "said"), [(0.02, "floor 0.02"), (None, "no floor")])
def test_a_channel_without_a_floor_is_printed_as_one(floor: float | None, said: str) -> None:
    assert f"    elbow: 0.5 -> 0.1 Nm ({said})" in [*_lines(report(floor), Path("out"))]


def test_what_each_error_is_of_is_printed_beside_it() -> None:
    """0.7 Nm unexplained of an error of 0.1 Nm: the one is of some samples, the other of all."""
    lines = [*_lines(report(), Path("out"))]
    assert lines == [
        "unexplained",
        "  held-out error (root mean square; the model as declared -> as repaired)",
        "    elbow: 0.5 -> 0.1 Nm (floor 0.02)",
        "  unexplained at elbow: 0.7 Nm",
        f"    rms of {OF_SIGNALS}",
        "    depends on elbow.velocity",
        "out/report.html",
    ]
    assert max(map(len, lines)) <= 80


def test_links_that_are_other_than_declared_are_at_no_joint() -> None:
    """They stood "at" an arm's first joint, as if that were the wrong one."""
    plain = {"parameters": {}, "indistinguishable_from": []}
    links = {"name": "link_inertia", "joint": "base", "where": "the links", **plain}
    # As a coordinator of an earlier version has it.
    older = {"name": "coulomb_friction", "joint": "elbow", **plain}
    lines = [*_lines(report() | {"effects": [links, older]}, Path("out"))]
    assert lines[1:3] == ["  link_inertia at the links", "  coulomb_friction at elbow"]


def test_what_is_refused_says_that_a_report_in_the_folder_is_older(tmp_path: Path) -> None:
    """Exit status 2 left it there, to be read as the answer."""

    def refused() -> str:
        with pytest.raises(Invalid) as caught, naming_older(tmp_path):
            raise Invalid("a.csv is wrong")
        return str(caught.value)

    assert refused() == "a.csv is wrong"
    (tmp_path / "report.json").touch()
    assert refused().startswith("a.csv is wrong") and "is an older answer" in refused()
