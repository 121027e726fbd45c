"""A session in which nothing moves is answered in the words of every other."""

import ast
import inspect
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.identification.findings import Event
from analysis.closeloop.load import load_session
from analysis.closeloop.report import json_report
from analysis.closeloop.report.left_out import of_left_out
from analysis.closeloop.report.still import still_answer
from analysis.closeloop.report.unexplained import event_entries, untouched
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.upright import joint_by_joint


def fields_of_a_report() -> set[str]:
    """Return the keys of the dictionary that a session with motion is reported as."""
    tree = ast.parse(inspect.getsource(json_report.json_report))
    every = [node for node in ast.walk(tree) if isinstance(node, ast.Dict)]
    largest = max(every, key=lambda node: len(node.keys))
    return {key.value for key in largest.keys if isinstance(key, ast.Constant)}


def test_it_has_every_field_of_another_report(recording: Recording) -> None:
    still = replace(
        recording,
        position=np.zeros_like(recording.position),
        velocity=np.zeros_like(recording.velocity),
        acceleration=np.zeros_like(recording.acceleration),
        still=True,
        cache={},
    )
    report = still_answer(still, ()).report
    assert fields_of_a_report() == set(report)
    assert report["verdict"] == "not_identifiable"


def test_a_joint_that_no_fitted_trial_moves_is_told(tmp_path: Path) -> None:
    """It was missing among the errors without a word."""
    joint_by_joint(tmp_path)
    file = tmp_path / "session.json"
    session = json.loads(file.read_text())
    session["trials"][2]["role"] = "holdout"
    file.write_text(json.dumps(session))
    recording = load_session(tmp_path)
    said = [recording.name(joint) for joint in recording.joints]
    assert said == ["pan", "lift"]
    assert of_left_out(recording, said) == [
        "bend does not move in the trials that are fitted: nothing is said of it"
    ]
    assert of_left_out(recording, [*said, "bend"]) == []


def test_an_event_has_the_torque_that_somebody_puts_on_the_joint_too(recording: Recording) -> None:
    """The motor must add -1 Nm where somebody pushes with 1 Nm along the axis."""
    (entry,) = event_entries(recording, [Event(trial=0, joint=0, begin=1.0, end=1.5, peak=-1.0)])
    assert (entry["peak"], entry["on_joint"]) == (-1.0, 1.0)
    (again,) = untouched(recording, [Event(trial=0, joint=0, begin=1.0, end=1.5, peak=-1.0)] * 2)
    assert recording.session.trials[0].file in again and "nobody" in again
    offset = BY_NAME["torque_offset"].parameters["torque"]
    assert offset.description.endswith("a torque on the joint has the opposite sign")


@pytest.mark.parametrize("beyond", [0.0, 0.2])
def test_an_event_at_the_end_of_a_declared_range_may_be_a_stop(
    recording: Recording, beyond: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real leg that had run into its own was said to be pushed, and nothing else."""
    event = Event(trial=0, joint=0, begin=1.0, end=1.5, peak=-1.0)
    during = (recording.time >= 1.0) & (recording.time <= 1.5) & (recording.trial == 0)
    farthest = float(recording.position[during, 0].max())
    monkeypatch.setattr(Device, "range", lambda *_: (farthest - 2.0, farthest + beyond))
    said = untouched(recording, [event])[1:]
    assert [line.split(" was at")[0] for line in said] == [recording.name(0)] * (not beyond)
