"""What the server's logic is given."""

from collections.abc import Callable

import pytest

from server.logic.fleet.verdicts import Report
from server.records import Plan
from tests.testbed.coordinators import records


@pytest.fixture
def plan() -> Callable[..., Plan]:
    return records.plan


@pytest.fixture
def report() -> Callable[..., Report]:
    return records.report
