"""A session whose joint hardly moves has an answer: whether somebody pushed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop import loop
from analysis.closeloop.contract import Verdict
from analysis.closeloop.session.recording import Recording


def test_a_joint_that_only_settles_is_not_fitted(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It moves, though for less than a fit has use for: there was a crash without rows."""
    count = len(recording.time)
    settled = 0.01 * np.exp(-np.arange(count) / 4.0)
    effort = np.array(recording.static)
    effort += 0.02 * np.random.default_rng(4).standard_normal(effort.shape)
    position = np.ones((count, 2)) + settled[:, None]
    rate = recording.rate
    velocity = np.gradient(position, 1.0 / rate, axis=0)
    held = replace(
        recording,
        position=position,
        velocity=velocity,
        acceleration=np.gradient(velocity, 1.0 / rate, axis=0),
        effort=effort,
        cache={},
    )
    monkeypatch.setattr(loop, "load_session", lambda folder: held)
    report = loop.analyse(Path()).report
    assert not held.still and report["verdict"] == Verdict.NOT_IDENTIFIABLE
    assert "no joint moves long enough" in report["warnings"][0]
