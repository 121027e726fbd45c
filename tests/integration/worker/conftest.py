"""Workers in tests that do not wait as long as real ones."""

import pytest


@pytest.fixture
def short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the tests to milliseconds: the lengths of the waits are not what they are about."""
    monkeypatch.setattr("worker.backoff.BASE_SECONDS", 0.005)
    monkeypatch.setattr("worker.backoff.FAREWELL_SECONDS", 0.05)
