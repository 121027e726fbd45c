"""Signals with stamps of their own, and what is said where a log has no clock or no effort."""

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.assignment import assigned
from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.draft import write_session
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.log import Channel, Log

TIME = np.arange(0.0, 4.0, 0.005)


def a_log(**arrays: np.ndarray) -> list[Belief]:
    return believe(Log(kind="CSV", channels=[Channel(name=n, values=v) for n, v in arrays.items()]))


def merged(late: float = 0.0013, slower: int = 1, names: tuple[str, str] = ("q", "tau")) -> Log:
    """Return two streams as a plotter merges them, by time: one number a row beside the stamp."""
    stamps = [(t, np.sin(t), np.nan) for t in TIME]
    stamps += [(t + late, np.nan, np.cos(t + late)) for t in TIME[::slower]]
    columns = zip(("time_s", *names), np.array(sorted(stamps)).T, strict=True)
    return Log(kind="CSV", channels=[Channel(name=name, values=values) for name, values in columns])


def written(folder: Path, chosen: list[Belief], *lines: str) -> tuple[np.ndarray, list[str]]:
    chosen, joints = assigned(chosen, lines)
    said = write_session(folder / "s", "log", chosen, joints)
    return np.loadtxt(folder / "s" / "log.csv", delimiter=",", skiprows=1), said


def test_an_effort_between_the_positions_is_taken_at_their_stamps(tmp_path: Path) -> None:
    """As of a stranger's exoskeleton: six topics in one table, one number a row."""
    table, said = written(tmp_path, believe(merged()))
    assert table[:, 0] == pytest.approx(TIME[1:]) and table.shape[1] == 3
    assert table[:, 2] == pytest.approx(np.cos(TIME[1:]), abs=1e-4)
    assert said[0].startswith("tau has other stamps than q, and was interpolated")


def test_nothing_is_taken_within_a_gap_of_the_efforts(tmp_path: Path) -> None:
    log = merged()
    tau = log.channels[2].values
    tau[(log.channels[0].values > 1.0) & (log.channels[0].values < 2.0)] = np.nan
    table, _ = written(tmp_path, believe(log))
    assert not ((table[:, 0] > 1.01) & (table[:, 0] < 1.99)).any() and len(table) > 500


@pytest.mark.parametrize(
    ("names", "slower", "why"),
    [
        (("knee.position", "hip.effort"), 1, "hip.effort has another clock and was left out"),
        (("q", "tau"), 10, "tau has another clock, too slow for q or beginning anew,"),
    ],
)
def test_efforts_of_no_joint_with_a_position_or_too_few_are_told(
    tmp_path: Path, names: tuple[str, str], slower: int, why: str
) -> None:
    log = merged(names=names, slower=slower)
    with pytest.raises(SessionError, match=rf"no effort is left: {why}.*\.effort\*FACTOR"):
        written(tmp_path, believe(log))


def test_what_is_said_of_a_missing_clock_works_as_it_is_typed(tmp_path: Path) -> None:
    """The stranger's own name and unit: `column 1=time*0.001` was no channel of the log."""
    steps = np.where(np.arange(400) % 3 == 0, 1000.0, 1.0)
    time = np.cumsum(steps)
    chosen = a_log(time=time, q=np.sin(time), tau=np.cos(time))
    with pytest.raises(SessionError, match="time has a clock's name, but its steps") as caught:
        written(tmp_path, chosen)
    (line,) = re.findall("--as '(.*)'", str(caught.value))
    table, _ = written(tmp_path, chosen, line.replace("SECONDS_PER_UNIT", "0.001"))
    assert table[:, 0] == pytest.approx(time / 1000.0)


def test_a_name_that_no_channel_has_is_told_as_that() -> None:
    with pytest.raises(ValueError, match="the log has no 'column 1', but t, q"):
        assigned(a_log(t=TIME, q=np.sin(TIME)), ["column 1=time*0.001"])


def test_of_many_channels_those_that_move_are_listed_and_how_many_there_are_more(
    tmp_path: Path,
) -> None:
    others = {f"signal{n}_x": np.cos(n * TIME) for n in range(1, 31)}
    held = {"mode": np.ones_like(TIME), "empty": np.full_like(TIME, np.nan)}
    with pytest.raises(SessionError, match="no effort is known among") as caught:
        written(tmp_path, a_log(t=TIME, q=np.sin(TIME), **held, **others))
    said = str(caught.value)
    assert "among signal2_x" in said and "and 11 more: name" in said
    assert "mode" not in said and "empty" not in said
