"""What the mu*-sigma plane promises: names that can be read."""

from analysis.reports.figures.plane import _labels


def test_names_of_points_that_lie_together_stand_on_different_sides_or_in_the_legend_only() -> None:
    same = (1.0, 0.5)
    assert _labels({"u1": same, "u2": same, "u3": same, "u4": same, "u5": same}) == {
        "u1": "top left",
        "u2": "top right",
        "u3": "bottom left",
        "u4": "bottom right",
    }


def test_a_name_that_is_alone_stands_above_and_towards_the_middle() -> None:
    assert _labels({"a": (2.0, 1.0), "b": (0.4, 0.1)}) == {"a": "top left", "b": "top right"}
    assert _labels({"a": (0.0, 0.0)}) == {"a": "top right"} and _labels({}) == {}
