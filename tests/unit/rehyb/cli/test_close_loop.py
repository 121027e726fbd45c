"""What closing a loop prints."""

from pathlib import Path
from typing import Any

import pytest

from analysis.closeloop.report.unexplained import OF_SIGNALS
from rehyb.cli import close_loop
from rehyb.cli.close_loop import _lines, _showing, naming_older
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


@pytest.mark.parametrize(
    ("after", "floor", "said"),
    [
        (0.4, 0.02, ["  most of the error of elbow is left: 64 % of its power above its noise"]),
        (0.4, None, ["  most of the error of elbow is left: 64 % of its power"]),
        (0.6, 0.02, ["  most of the error of elbow is left: 100 % of its power above its noise"]),
        (0.1, 0.02, []),
        (0.48, 0.48, []),
    ],
)
def test_effects_that_leave_most_of_the_error_are_said_to_first(
    after: float, floor: float | None, said: list[str]
) -> None:
    """Of unmodelled drag two effects took a fifth: `effect_found` sounded whole (a stranger's)."""
    found = report(floor) | {"verdict": "effect_found"}
    found["error"]["holdout"]["elbow"]["after"] = after
    lines = [*_lines(found, Path("out"))]
    assert [line for line in lines if "most of the error" in line] == said
    assert lines[1 : 1 + len(said)] == said
    assert not any("most of" in line for line in _lines(report(floor), Path("out")))


def test_a_number_without_a_dimension_has_no_unit() -> None:
    """`side` was "-1 [-1, -1] 1" (a stranger's)."""
    sizes = {"side": {"value": -1.0, "ci90": [-1.0, -1.0], "unit": "1"}}
    sizes["gain"] = {"value": 2.5, "ci90": [2.0, 3.0], "unit": "Nm s/rad"}
    reflex = {"name": "stretch_reflex", "joint": "elbow", "parameters": sizes}
    lines = [*_lines(report() | {"effects": [reflex | {"indistinguishable_from": []}]}, Path())]
    assert lines[2].split() == ["side", "-1", "[-1,", "-1]"] and not lines[2].endswith(" ")
    assert lines[3].endswith("[2, 3] Nm s/rad")


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


def test_a_declared_payload_is_printed_with_its_interval() -> None:
    """Its mass stood in report.json alone."""
    place = [[-0.02, 0.01], None, [0.05, 0.3]]
    weight = {
        "effect": "payload",
        "name": "weight",
        "body": "link6",
        "parameters": {
            "mass": {"value": 0.1717, "ci90": [0.1139, 0.2294], "unit": "kg"},
            "position": {"value": [-0.01, None, 0.18], "ci90": place, "unit": "m"},
            "inertia": {"value": None, "ci90": None, "unit": "kg m2"},
        },
    }
    lines = [*_lines(report() | {"declared": [weight]}, Path("out"))]
    assert lines[1:7] == [
        "  declared payload weight at link6",
        "    mass                    0.1717 [0.1139, 0.2294] kg",
        "    position_x               -0.01 [-0.02, 0.01] m",
        "    position_y           not determined",
        "    position_z                0.18 [0.05, 0.3] m",
        "    inertia              not determined",
    ]
    rubs = {"effect": "coulomb_friction", "joint": "elbow", "parameters": {}}
    assert "  declared coulomb_friction at elbow" in [
        *_lines(report() | {"declared": [rubs]}, Path("out"))
    ]


def test_a_file_is_told_of_stages_once_it_takes_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of minutes on six joints nothing was said, for standard error was no terminal."""
    now = [100.0]
    monkeypatch.setattr(close_loop.time, "monotonic", lambda: now[0])
    show = _showing()
    show("reading")
    now[0] = 142.0
    for stage in ("queued", "queued", "joint3: what else"):
        show(stage)
    assert capsys.readouterr().err.splitlines() == [
        "rehyb: queued, after 42 s",
        "rehyb: joint3: what else, after 42 s",
    ]
