"""Which signals of a log are the derivatives of which, and what that tells."""

import numpy as np
import pytest

from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.clock import clock_of
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.log import Channel, Log


def test_a_fast_motion_tells_the_rate_as_well_as_a_slow_one() -> None:
    """A position's slope is smoothed more than its velocity was: of a leg's 227 Hz it made 244."""
    time = np.arange(0.0, 10.0, 0.005)
    speeds = 2 * np.pi * np.array([3.0, 5.0, 7.0])
    signals = {"q": np.sin(np.outer(time, speeds)), "dq": speeds * np.cos(np.outer(time, speeds))}
    channels = [
        Channel(name=f"{name}{n}", values=table[:, n])
        for name, table in signals.items()
        for n in range(3)
    ]
    for belief in believe(Log(kind="CSV", channels=channels)):
        found = belief.channel.time
        assert found is not None and clock_of(found).rate == pytest.approx(200.0, rel=1e-3)


def swing() -> dict[str, np.ndarray]:
    """Return time, and positions and velocities, (n, 2), of a smooth motion at 100 Hz, SI units."""
    time = np.arange(0.0, 8.0, 0.01)
    speeds = np.array([2.0, 3.1])
    phase = np.outer(time, speeds)
    return {"time": time, "position": np.sin(phase), "velocity": speeds * np.cos(phase)}


def recorded(prefix: str, time: np.ndarray) -> list[Belief]:
    """Believe a topic's array of positions, velocities, efforts and a clock, of two joints."""
    m = swing()
    table = np.column_stack([m["position"], m["velocity"], 3 * m["position"], m["time"]])
    channels = [
        Channel(name=f"{prefix}[{n}]", values=values, time=time) for n, values in enumerate(table.T)
    ]
    return believe(Log(kind="ROS bag", channels=channels))


def test_columns_of_an_array_without_names_are_told_by_physics_below_any_topic() -> None:
    """An arm's `robot.information.data[0..21]` was all unknown: its topic has a name."""
    found = recorded("robot.information.data", swing()["time"])
    assert [(b.quantity, b.joint) for b in found[:6]] == [
        *(("position", 0), ("position", 1), ("velocity", 0), ("velocity", 1)),
        *(("effort", 0), ("effort", 1)),
    ]
    assert {b.quantity for b in recorded("gripper.tool.data", swing()["time"])[:6]} == {"unknown"}


def test_a_clock_within_a_message_goes_before_the_less_even_one_of_its_recording() -> None:
    """An arm's messages came late by 0 to 40 ms; they held the time at which each was measured."""
    time = swing()["time"]
    late = 1.7e9 + time + np.random.default_rng(0).uniform(0.0, 0.004, len(time))
    found = recorded("state.data", late)
    own = found[0].channel.time
    assert found[6].quantity == "time"
    assert own is not None and clock_of(own).jitter < 1e-3
    assert abs(np.median(own - late)) < 1e-6


def test_a_clock_that_tells_another_time_than_the_recording_is_none_of_its() -> None:
    time = swing()["time"]
    late = np.random.default_rng(0).uniform(0.0, 0.004, len(time))
    found = recorded("state.data", 3.0 * time + late)
    assert found[6].quantity == "unknown"


def test_the_stamp_of_the_positions_goes_before_the_clock_that_topics_share() -> None:
    """A plotter's table of two topics was said to have 2000 Hz and 93 gaps; its stamps are even.

    Each line is of one topic, and has the time at which it came.
    """
    rng = np.random.default_rng(0)
    m = swing()
    came = m["time"] + rng.uniform(0.0, 0.004, len(m["time"]))
    other = np.concatenate([came[1:] - 0.001, came[1:] - 0.002])
    order = np.argsort(np.concatenate([came, other]))
    signals = {"stamp": m["time"], "q": m["position"][:, 0], "dq": m["velocity"][:, 0]}
    lines = {name: np.append(v, np.full(len(other), np.nan)) for name, v in signals.items()}
    lines = {"__time": np.concatenate([came, other]), **lines}
    found = believe(
        Log(kind="CSV", channels=[Channel(name=n, values=v[order]) for n, v in lines.items()])
    )
    assert [b.quantity for b in found] == ["unknown", "time", "position", "velocity"]
    own = found[2].channel.time
    assert own is not None and clock_of(own).jitter < 1e-3
    assert found[2].unit == "rad?" and found[3].source == 2


def test_arrays_much_shorter_than_a_log_are_no_signals_of_it() -> None:
    """Gains and backlashes of six axes, `K_pos` and `q_back`, were positions of joints."""
    signals = {"time": swing()["time"], "q": swing()["position"][:, 0]}
    signals |= {"K_pos": np.arange(6.0), "q_back": np.full(6, 3e-5)}
    found = believe(
        Log(kind="MATLAB", channels=[Channel(name=n, values=v) for n, v in signals.items()])
    )
    assert [b.quantity for b in found] == ["time", "position", "unknown", "unknown"]
    assert found[3].why == "holds 6 numbers, too few for a signal of this log"


def test_a_setpoint_is_no_derivative_of_another_joints() -> None:
    """A KUKA LWR's targets are sines: one joint's acceleration goes as another's position rises."""
    time = swing()["time"]
    signals = {"time": time}
    for n, (size, phase) in enumerate([(0.8, 0.0), (0.8, np.pi / 2), (0.5, 1.0)]):
        signals[f"target_positions[{n}]"] = size * np.sin(time + phase)
        signals[f"target_velocities[{n}]"] = size * np.cos(time + phase)
        signals[f"target_accelerations[{n}]"] = -size * np.sin(time + phase)
    found = believe(
        Log(kind="NumPy", channels=[Channel(name=n, values=v) for n, v in signals.items()])
    )
    names = [b.channel.name for b in found]
    for at, belief in enumerate(found):
        assert "it is the derivative" not in belief.why
        if belief.source is not None:
            assert names[belief.source][-3:] == names[at][-3:]
