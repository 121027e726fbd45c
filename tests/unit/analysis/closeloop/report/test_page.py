"""Pictures of a residual say what each axis, line and band is."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.identification.balance.accuracy import raw_errors
from analysis.closeloop.load import load_session
from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.page import UNCHANGED, _evidence, _trials
from tests.testbed.sessions.small import Folder


@pytest.fixture
def found(tmp_path: Path) -> Answer:
    """An answer to a file with two trials, of which the second is pushed."""
    folder = Folder(tmp_path)
    halves = ({"from": 0.0, "to": 5.0}, {"from": 5.0, "to": 10.0})
    folder.session["trials"] = [{"file": "a.csv", **half} for half in halves]
    recording = load_session(folder.write())
    errors = raw_errors(recording, recording.static, (0, 1))
    pushed = {"file": "a.csv", "from": 7.0, "to": 7.5}
    report = {"unexplained": {"elbow": {"events": [pushed]}}}
    without = raw_errors(recording, np.zeros_like(recording.static), (0, 1))
    return Answer(report=report, recording=recording, before=without, after=errors)


def named(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_axes_of_what_a_residual_goes_with_have_names_and_units(found: Answer) -> None:
    panels = _evidence(found, found.recording.joints[0]).axes
    assert {axes.get_ylabel() for axes in panels} == {"residual, Nm"}
    assert [axes.get_xlabel() for axes in panels] == [
        "velocity, rad/s",
        "position, rad",
        "acceleration, rad/s²",
    ]
    assert named(panels[-1]) == ["before", "after"]


def test_an_event_is_a_band_in_its_own_trial_and_named_with_the_lines(found: Answer) -> None:
    panels = _trials(found, found.recording.joints[0]).axes
    assert {(axes.get_xlabel(), axes.get_ylabel()) for axes in panels} == {
        ("time, s", "residual, Nm")
    }
    assert not panels[0].patches and len(panels[1].patches) == 1
    assert named(panels[0]) == ["before", "after", "event"]


def test_where_nothing_is_repaired_there_is_one_line_that_says_so(found: Answer) -> None:
    """The residual after hid that before, of which the legend spoke all the same."""
    same = replace(found, before=found.after)
    for draw in (_evidence, _trials):
        panels = draw(same, same.recording.joints[0]).axes
        shown = next(axes for axes in panels if axes.get_legend() is not None)
        assert UNCHANGED in named(shown) and "after" not in named(shown)
