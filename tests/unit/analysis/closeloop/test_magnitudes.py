"""Efforts without their sign are told as that, and nothing else is taken for them."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.logs.draft import of_magnitudes
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.magnitudes import SAID, are_magnitudes
from tests.testbed.sessions.upright import NAMES, all_at_once

TIME = np.arange(0.0, 60.0, 0.01)
DIGIT = 0.02


def coarse(effort: np.ndarray) -> np.ndarray:
    """Return an effort in whole digits, as cheap drives report it."""
    return DIGIT * np.round(effort / DIGIT)


def motion(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position and signed effort of a joint that rubs and moves to and fro."""
    position = np.sin((1.0 + 0.3 * number) * TIME)
    speed = np.gradient(position)
    return position, coarse(0.1 * np.tanh(speed / (0.3 * np.abs(speed).max())) + 0.1 * position)


def test_magnitudes_of_two_joints_or_more_are_told_whichever_way_they_are_turned() -> None:
    signed = {str(n): [motion(n)] for n in range(3)}
    assert not are_magnitudes(signed)
    unsigned = {n: [(q, np.abs(u)) for q, u in own] for n, own in signed.items()}
    assert are_magnitudes(unsigned)
    turned = unsigned | {"1": [(q, -u) for q, u in unsigned["1"]]}
    assert are_magnitudes(turned)
    assert not are_magnitudes(unsigned | {"2": signed["2"]})
    assert not are_magnitudes({"0": unsigned["0"]})


def test_gravity_that_pulls_one_way_makes_no_magnitudes() -> None:
    held = {str(n): [(motion(n)[0], coarse(1.0 + motion(n)[1]))] for n in range(3)}
    assert not are_magnitudes(held)
    # With brakes, efforts are 0 at rest.
    position = np.clip(3.0 * np.sin(2 * TIME), -1.0, 1.0)
    braked = np.where(np.abs(position) < 1.0, coarse(1.0 + 0.2 * np.cos(4 * TIME)), 0.0)
    assert not are_magnitudes({str(n): [(position, braked)] for n in range(3)})


def test_joints_that_move_one_way_say_nothing() -> None:
    speed = np.abs(np.sin(3 * TIME))
    ways = {str(n): [(np.cumsum(speed), coarse(0.1 * speed))] for n in range(3)}
    assert not are_magnitudes(ways)


def test_a_log_of_magnitudes_is_told_when_it_is_looked_at() -> None:
    signals = {"t": TIME}
    for number in range(2):
        position, effort = motion(number)
        signals |= {f"q{number}": position, f"tau{number}": np.abs(effort)}
    channels = [Channel(name=name, values=values) for name, values in signals.items()]
    assert of_magnitudes(believe(Log(kind="CSV", channels=channels))) == [SAID]


def test_a_session_of_magnitudes_is_refused_as_that(tmp_path: Path) -> None:
    """Each joint's effort in turn was said to have the opposite sign."""
    all_at_once(tmp_path, 29)
    file = tmp_path / "all.csv"
    header, *rows = file.read_text().splitlines()
    names = header.split(",")
    table = np.array([[float(x) for x in row.split(",")] for row in rows])
    for name in NAMES:
        at = names.index(f"{name}.effort")
        effort = table[:, at] - table[:, at].mean()
        digit = np.abs(effort).max() / 8
        table[:, at] = np.abs(digit * np.round(effort / digit))
    np.savetxt(file, table, delimiter=",", header=header, comments="", fmt="%.10g")
    with pytest.raises(SessionError, match="are magnitudes") as caught:
        load_session(tmp_path)
    assert caught.value.column == f"{NAMES[0]}.effort"
