"""A session in which nothing moves is answered in the words of every other."""

import ast
import inspect
from dataclasses import replace

import numpy as np

from analysis.closeloop.report import json_report
from analysis.closeloop.report.still import still_answer
from analysis.closeloop.session.recording import Recording


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
