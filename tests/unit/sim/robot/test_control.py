"""The controller's gains."""

from sim.parameters.conditions import DEFAULT_CONDITIONS, split
from sim.robot.control import Gains


def test_gains_are_multiples_of_the_devices_own() -> None:
    _, conditions = split({"proportional_gain": 2.0, "derivative_gain": 0.5, "integral_gain": 0.0})
    own = Gains(kp=50.0, kv=15.0, ki=25.0)
    assert own.under(conditions) == Gains(kp=100.0, kv=7.5, ki=0.0)
    assert own.under(DEFAULT_CONDITIONS) == own
