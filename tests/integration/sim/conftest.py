"""What the tests of whole assessments share."""

import pytest

from sim.assessment.assess import Assessment
from tests.testbed.assessments import Assess, remembering


@pytest.fixture(scope="session")
def assessed() -> Assess:
    """Return `assess` with a memory as long as the session."""
    return remembering()


@pytest.fixture(scope="session")
def nominal(assessed: Assess) -> Assessment:
    """Return the nominal wearer's assessment in contact."""
    return assessed({})
