"""Logs of other layouts: the NESM bench, a robot's own names, and maps that cannot be right."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from sim.assessment.nominal import nominal_model
from tests.testbed.sessions.small import rows
from tests.testbed.sessions.synthetic import Arm, mjcf

#: A log under a robot's own names: degrees, current instead of torque, separated by blanks.
NAMES = ("timestamp", "actual_q_0", "actual_q_1", "actual_current_1")
UR_MAP = {
    "separator": "space",
    "map": {
        "time": "timestamp",
        "shoulder.position": {"from": "actual_q_0"},
        "elbow.position": {"from": "actual_q_1", "scale": np.pi / 180, "offset": 0.1},
        "elbow.effort": {"from": "actual_current_1", "scale": 0.11},
    },
}


def session(path: Path, columns: Any, **changes: Any) -> Path:
    content = {
        "schema": 1,
        "model": "device.xml",
        "columns": columns,
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}],
        "trials": [{"file": "log.txt"}],
    } | changes
    (path / "session.json").write_text(json.dumps(content))
    (path / "device.xml").write_text(mjcf(Arm()))
    return path


def write_log(path: Path, **spoilt: str) -> None:
    table = rows()
    log = np.column_stack(
        [table[:, 0], table[:, 1], np.degrees(table[:, 2] - 0.1), table[:, 4] / 0.11]
    )
    lines = [" ".join(f"{x:.9g}" for x in row) for row in log]
    lines[40] = spoilt.get("line_42", lines[40])
    (path / "log.txt").write_text("\n".join([" ".join(NAMES), *lines]) + "\n")


def test_a_robots_own_names_and_units_become_the_contracts(tmp_path: Path) -> None:
    write_log(tmp_path)
    recording = load_session(session(tmp_path, UR_MAP))
    read = recording.session
    columns = read.trials[0].columns
    assert set(columns) == {"shoulder.position", "elbow.position", "elbow.effort"}
    assert columns["elbow.position"] == pytest.approx(rows()[:, 2], abs=1e-7)
    assert columns["elbow.effort"] == pytest.approx(rows()[:, 4], rel=1e-7)
    assert recording.joints == (recording.device.joints.index("elbow"),)


def test_a_map_may_be_a_file_of_the_folder_or_belong_to_one_trial(tmp_path: Path) -> None:
    write_log(tmp_path)
    (tmp_path / "ur.json").write_text(json.dumps(UR_MAP))
    by_file = load_session(session(tmp_path, "ur.json")).session
    trials = [{"file": "log.txt", "columns": UR_MAP}]
    by_trial = load_session(session(tmp_path, None, trials=trials)).session
    for name, signal in by_file.trials[0].columns.items():
        assert np.array_equal(signal, by_trial.trials[0].columns[name])


def test_a_log_without_a_clock_has_a_rate(tmp_path: Path) -> None:
    write_log(tmp_path)
    sources = {name: source for name, source in UR_MAP["map"].items() if name != "time"}  # type: ignore[attr-defined]
    read = load_session(session(tmp_path, {**UR_MAP, "map": sources, "rate_hz": 200})).session
    assert read.trials[0].time == pytest.approx(rows()[:, 0], abs=1e-9)


def with_empty(path: Path, phase: list[int], effort: list[int]) -> Path:
    """Write a log with a gait's phase that nobody needs, and a session that maps it.

    Args:
        path: of the folder.
        phase: samples at which the phase is empty.
        effort: samples at which the effort is.
    """
    table = [[f"{x:.9g}" for x in row] for row in rows()[:, [0, 1, 2, 4]]]
    for number, row in enumerate(table):
        row[3] = "" if number in effort else row[3]
        row.append("" if number in phase else "0.5")
    names = ["t", "q0", "q1", "tau", "phase"]
    (path / "log.txt").write_text("\n".join(",".join(row) for row in [names, *table]) + "\n")
    signals = ["time", "shoulder.position", "elbow.position", "elbow.effort", "gait_phase"]
    return session(path, {"map": dict(zip(signals, names, strict=True))})


def test_a_column_of_no_joint_with_empty_cells_is_left_out_as_a_whole(tmp_path: Path) -> None:
    """A stranger's walk, whose phase begins with the first steps, was refused."""
    (trial,) = load_session(with_empty(tmp_path, [*range(300)], [])).session.trials
    assert len(trial.time) == len(rows()) and "gait_phase" not in trial.columns
    assert "column gait_phase is empty in 300 of 2000 samples, and was left out" in trial.repairs


def test_few_empty_cells_of_a_mapped_log_are_samples_that_it_missed(tmp_path: Path) -> None:
    (trial,) = load_session(with_empty(tmp_path, [7], [50, 51])).session.trials
    assert len(trial.time) == len(rows()) - 3 and "gait_phase" in trial.columns
    assert "3 samples with an empty cell were left out" in trial.repairs


def test_an_effort_with_many_empty_cells_is_refused_by_line(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match=r"elbow\.effort, line 102: is empty, as in 300 of 2000"):
        load_session(with_empty(tmp_path, [], [*range(100, 400)]))


@pytest.mark.parametrize("column", [4, 5])
def test_an_own_table_is_read_alike(tmp_path: Path, column: int) -> None:
    header = ["time", "shoulder.position", "elbow.position", "elbow.velocity", "elbow.effort"]
    table = [[*(f"{x:.9g}" for x in row), "0.5"] for row in rows()]
    for row in table[100:400]:
        row[column] = ""
    lines = [",".join(row) for row in [[*header, "gait_phase"], *table]]
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    folder = session(tmp_path, None)
    if column == 4:
        with pytest.raises(SessionError, match=r"elbow\.effort, line 102: is empty, as in 300"):
            load_session(folder)
        return
    (trial,) = load_session(folder).session.trials
    assert "gait_phase" not in trial.columns and len(trial.time) == len(rows())


def bench(path: Path, *, lines: int = 33) -> np.ndarray:
    """Write a bench log of an elbow swing; return its positions in rad, (n, 4)."""
    t = np.arange(1200) / 100.0
    position = np.tile([0.0, -np.pi / 2, 0.0, 0.0], (len(t), 1))
    position[:, 3] = 0.8 - 0.5 * np.cos(1.5 * t) + 0.1 * np.sin(4 * t)
    velocity = np.gradient(position, 0.01, axis=0)
    effort = nominal_model().inverse_dynamics(
        position, velocity, np.gradient(velocity, 0.01, axis=0)
    )
    log = np.zeros((33, len(t)))
    log[0] = 7000 + np.arange(len(t))
    for joint, first in enumerate((1, 6, 11, 16)):
        log[first + 2] = np.degrees(position[:, joint])
        log[first + 3] = effort if joint == 3 else 0.01 * np.sin(t)
    np.savetxt(path / "log.txt", log[:lines], delimiter=",", fmt="%.9g")
    return position


def test_the_nesm_bench_is_read_with_the_nominal_arm(tmp_path: Path) -> None:
    position = bench(tmp_path)
    declared = [{"effect": "viscoelastic_joint", "joint": "J4"}]
    folder = session(tmp_path, "nesm_bench", model="nominal", declared_effects=declared)
    recording = load_session(folder)
    read = recording.session
    trial = read.trials[0]
    assert trial.time[0] == 70.0 and np.diff(trial.time) == pytest.approx(0.01)
    for joint in range(4):
        assert trial.columns[f"J{joint + 1}.position"] == pytest.approx(position[:, joint])
    assert recording.extra_names == ("J4.desired_torque",)
    assert recording.joints == (3,)


def test_a_preset_can_be_corrected_line_by_line(tmp_path: Path) -> None:
    bench(tmp_path)
    columns = {"preset": "nesm_bench", "map": {"J2.position": {"from": 9, "scale": -np.pi / 180}}}
    declared = [{"effect": "viscoelastic_joint", "joint": "J4"}]
    read = load_session(
        session(tmp_path, columns, model="nominal", declared_effects=declared)
    ).session
    assert read.trials[0].columns["J2.position"] == pytest.approx(np.pi / 2)


def test_a_bench_file_with_too_few_lines_is_said(tmp_path: Path) -> None:
    bench(tmp_path, lines=18)
    with pytest.raises(SessionError, match=r"J4\.position: is missing: the map takes it from line"):
        load_session(session(tmp_path, "nesm_bench", model="nominal", declared_effects=[]))


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (7, "columns must be an object, a file of the folder or one of nesm_bench"),
        ("no_such_preset", "no such file"),
        ("../ur.json", "leaves the session's folder"),
        ({"preset": "ur"}, r"columns\.preset must be one of nesm_bench"),
        ({"layout": "diagonal"}, r"columns\.layout must be one of columns, rows"),
        ({"separator": "|"}, r"columns\.separator must be one of comma"),
        ({"columns": {}}, r"columns\.columns is unknown"),
        ({}, r"columns\.map must be an object"),
        ({"map": {"elbow.position": "q"}}, "needs a time, or rate_hz"),
        ({"map": {"time": "t"}, "rate_hz": 100}, "not both"),
        ({"map": {"time": "t"}, "rate_hz": "fast"}, "rate_hz must be a number"),
        ({"map": {"time": ["t"]}}, r"columns\.map\.time must be an object"),
        ({"map": {"time": {"from": "t", "factor": 2}}}, r"columns\.map\.time must be an object"),
        ({"map": {"time": {"from": 0}}}, "must be a name of the header"),
        ({"layout": "rows", "map": {"time": "t"}}, "must be the number of a line"),
        ({"map": {"time": {"from": "t", "scale": 0}}}, "no scale of 0"),
        ({"map": {"time": {"from": "t", "scale": float("nan")}}}, "finite numbers"),
        (
            {**UR_MAP, "map": {**UR_MAP["map"], "elbow.effort": "torque"}},  # type: ignore[dict-item]
            "log.txt, column elbow.effort, line 1: is missing: the map takes it from 'torque'",
        ),
        ({**UR_MAP, "separator": "comma"}, "column time, line 1: is missing: the map takes"),
        (
            {"separator": "space", "map": {"time": "timestamp"}},
            "log.txt, column shoulder.position, line 1: is missing",
        ),
    ],
)
def test_a_map_that_cannot_be_right_is_one_error(tmp_path: Path, columns: Any, words: str) -> None:
    write_log(tmp_path)
    with pytest.raises(SessionError, match=words):
        load_session(session(tmp_path, columns))


@pytest.mark.parametrize(
    ("line", "words"),
    [("1 2 3", "line 42: has 3 cells"), ("0.2 0 zero 1", "elbow.position, line 42: holds 'zero'")],
)
def test_a_line_that_cannot_be_right_is_found(tmp_path: Path, line: str, words: str) -> None:
    write_log(tmp_path, line_42=line)
    with pytest.raises(SessionError, match=words):
        load_session(session(tmp_path, UR_MAP))
