"""A rich recording without noise, made once."""

import pytest

from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import rich_recording


@pytest.fixture(scope="package")
def recording() -> Recording:
    return rich_recording()
