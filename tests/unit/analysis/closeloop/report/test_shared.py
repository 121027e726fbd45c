"""A link whose moments alone are known has no mass."""

import numpy as np
import pytest

from analysis.closeloop.report.named import refused_values
from analysis.closeloop.report.shared import _link


def test_a_mass_that_could_be_none_has_no_value_nor_has_its_centre() -> None:
    """As of a robot's upper arm, near whose axis a large mass makes no torque: 81 kg, 0 to 224."""
    found = _link(np.array([81.0, 0.0, 0.1, 0.01]), np.array([143.0, 0.02, 0.1, 0.02]))
    assert all(entry["value"] is None and entry["ci90"] is None for entry in found.values())
    (said,) = refused_values([{"name": "links", "joint": "lift", "parameters": found}])
    assert said.startswith(
        "links of lift: mass is not determined, its 90 % interval, -62 to 224 kg"
    )


def test_a_mass_that_is_known_has_an_interval() -> None:
    found = _link(np.array([4.0, 0.2, 0.0, -0.1]), np.array([3.5, 0.01, 0.02, 0.03]))
    assert found["mass"] == {"value": 4.0, "ci90": [0.5, 7.5], "unit": "kg"}
    assert found["position_z"]["ci90"] == pytest.approx([-0.13, -0.07])
