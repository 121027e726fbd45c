"""What the tests of the simulation share."""

import pytest

from sim.parameters.wearer import NOMINAL_WEARER
from sim.system.build import build_system
from sim.system.system import System


@pytest.fixture(scope="session")
def nominal_system() -> System:
    """Return the nominal wearer's system in contact; tests leave its model as it is."""
    return build_system(NOMINAL_WEARER)
