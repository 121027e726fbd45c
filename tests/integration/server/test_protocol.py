"""Whatever is asked in whatever order, the coordinator does what a model without a database does.

Hypothesis plays workers, an operator, the clock, and a database that fails between any two
statements, over REST. `make soak` plays longer.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.testbed.protocol.story import Story

#: Stories told on each database, and what happens in each of them.
STORIES = int(os.environ.get("REHYB_PROTOCOL_STORIES", "4"))
STEPS = 20


@pytest.fixture(params=["sqlite", "postgresql"])
def told_on(
    request: pytest.FixtureRequest, upgraded_file: Path, tmp_path: Path
) -> Callable[[], Story]:
    """Begins a story on a database that is empty."""
    if request.param == "sqlite":
        url = f"sqlite:///{shutil.copyfile(upgraded_file, tmp_path / 'story.sqlite3')}"
    else:
        url = request.getfixturevalue("upgraded_database")()
    return lambda: Story(url)


def test_the_coordinator_does_what_its_model_does(told_on: Callable[[], Story]) -> None:
    run_state_machine_as_test(  # type: ignore[no-untyped-call]
        told_on,
        settings=settings(
            max_examples=STORIES,
            stateful_step_count=STEPS,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
