"""Further gravity at a limb, and where it is an unlikely name."""

import pytest

from analysis.closeloop.identification.balance.model import unfitted
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.plants import LIMB
from tests.testbed.sessions.rich import swung


@pytest.mark.parametrize(
    ("gravity", "unlikely"),
    [("0 0 -9.81", True), ("0 1.5 -9.7", True), ("0 3.4 -9.2", False), ("0 0 0", False)],
    ids=["upright", "nine degrees off", "twenty degrees off", "a model without gravity"],
)
def test_another_gravity_is_unlikely_where_an_axis_stands_upright(
    gravity: str, unlikely: bool
) -> None:
    model = LIMB.changed('gravity="0 0 0"', f'gravity="{gravity}"')
    joint = unfitted(swung(model, (0.6,), (0.4,)), 0)
    assert BY_NAME["gravity_torque"].unlikely(joint, {"turned": 0.0}) is unlikely
