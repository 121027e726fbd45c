"""Files that hold several trials of the same signals become one session of several trials."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.logs import trials as joining
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.clock import stretches
from analysis.closeloop.logs.draft import write_session
from analysis.closeloop.logs.hdf5 import read as read_hdf5
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.joints import joint_names
from analysis.closeloop.logs.log import Log
from analysis.closeloop.logs.reading import read_log

h5py = pytest.importorskip("h5py", reason="needs the extra logs")
#: Samples of three trials, at 100 Hz.
LENGTHS = (300, 420, 200)


def trials(begin: float = 0.0) -> list[dict[str, np.ndarray]]:
    """Return time, angle, velocity and torque of each; their clocks begin `begin` s apart."""
    found = []
    for number, length in enumerate(LENGTHS):
        time = 0.01 * np.arange(length)
        angle, velocity = np.sin(2 * time + number), 2 * np.cos(2 * time + number)
        signals = {"time": time + number * begin, "angle": angle, "torque": 3 * angle}
        found.append({**signals, "x": velocity})
    return found


def hdf5(path: Path, groups: Mapping[str, Mapping[str, np.ndarray]]) -> Log:
    with h5py.File(path / "log.h5", "w") as file:
        for group, signals in groups.items():
            for name, values in signals.items():
                file[f"{group}/{name}"] = values
    return read_log(path / "log.h5")


def matlab(path: Path, **content: Any) -> Log:
    from scipy.io import savemat

    savemat(path / "log.mat", content)
    return read_log(path / "log.mat")


def session_of(log: Log, folder: Path) -> tuple[list[dict[str, str]], list[np.ndarray], list[str]]:
    """Write a session; return its trials, their tables, and what is left to settle."""
    beliefs = believe(log)
    remarks = write_session(folder, "log", beliefs, joint_names(beliefs))
    told = json.loads((folder / "session.json").read_text())["trials"]
    tables = [np.loadtxt(folder / trial["file"], delimiter=",", skiprows=1) for trial in told]
    return told, tables, remarks


@pytest.mark.parametrize("begin", [0.0, 10.0])
def test_groups_of_the_same_signals_are_trials_and_no_joints(tmp_path: Path, begin: float) -> None:
    """They were three joints, and the session was refused."""
    log = hdf5(tmp_path, {f"run/trial_{n + 8}": trial for n, trial in enumerate(trials(begin))})
    assert [channel.name for channel in log.channels] == [
        *("run.angle", "run.time", "run.torque", "run.x")
    ]
    assert log.remarks == [
        "3 trials hold the same signals: trial_8 (300 samples), trial_9 (420 samples), "
        "trial_10 (200 samples)"
    ]
    told, tables, remarks = session_of(log, tmp_path / "session")
    assert [trial["label"] for trial in told] == ["trial_8", "trial_9", "trial_10"]
    assert [len(table) for table in tables] == [*LENGTHS]
    assert tables[2][:, 1] == pytest.approx(trials()[2]["angle"], abs=1e-8)
    # A clock that goes on is kept; one that begins anew is shifted, and that is said.
    assert any("begins anew 2 times" in remark for remark in remarks) == (begin == 0.0)
    assert tables[1][0, 0] == pytest.approx(10.0 if begin else 3.99)


def test_a_velocity_is_told_by_physics_in_trials_as_in_one(tmp_path: Path) -> None:
    log = hdf5(tmp_path, {f"trial{n}": trial for n, trial in enumerate(trials())})
    found = {belief.channel.name: belief for belief in believe(log)}
    assert (found["x"].quantity, found["x"].joint) == ("velocity", found["angle"].joint)


@pytest.mark.parametrize("rate_hz", [None, 100.0])
def test_trials_too_short_or_without_numbers_are_not_compared(rate_hz: float | None) -> None:
    """Both ended in a traceback; of all trials together the samples are enough."""
    names = ("q1", "q2", "dq1", "dq2")
    short = [(f"trial{n}/{name}", np.sin(np.arange(5.0) + n)) for n in range(20) for name in names]
    assert len(believe(log_of("HDF5", short), rate_hz)) == 4
    lengths = {"trial1": 400, "trial2": 300, "trial3": 300}
    arrays = {f"{at}/{name}": np.sin(np.arange(n)) for at, n in lengths.items() for name in names}
    arrays["trial1/dq2"] = np.full(400, np.nan)
    assert len(believe(log_of("HDF5", arrays.items()), rate_hz)) == 4


def test_many_short_trials_have_a_clock(tmp_path: Path) -> None:
    """It began anew too often to be one."""
    time = 0.01 * np.arange(20)
    signals = {"time": time, "q": np.sin(time), "torque": np.cos(time)}
    arrays = {f"trial{n}/{name}": array for n in range(9) for name, array in signals.items()}
    told, tables, _ = session_of(log_of("HDF5", arrays.items()), tmp_path / "session")
    assert [trial["label"] for trial in told] == [f"trial{n}" for n in range(9)]
    assert {len(table) for table in tables} == {20}


def test_groups_with_other_names_are_trials_if_their_clocks_differ(tmp_path: Path) -> None:
    names = ("slow", "fast", "low")
    log = hdf5(tmp_path, dict(zip(names, trials(), strict=True)))
    assert log.channels[0].trials == (("fast", 0), ("low", 420), ("slow", 620))
    # Those of one clock are joints.
    same = hdf5(tmp_path, {"elbow": trials()[0], "wrist": trials()[0]})
    assert {belief.joint for belief in believe(same)} == {None, 0, 1}


def test_numbered_joints_are_no_trials(tmp_path: Path) -> None:
    log = hdf5(tmp_path, {f"joint_{n}": trials()[0] for n in (1, 2)})
    assert len(log.channels) == 8 and not any(channel.trials for channel in log.channels)


def test_a_signal_that_one_trial_lacks_is_left_out_and_said(tmp_path: Path) -> None:
    first, second, _ = trials()
    log = hdf5(tmp_path, {"trial1": {**first, "emg": first["angle"]}, "trial2": second})
    assert "trial1/emg" in log.remarks[0] and len(log.channels) == 4


@pytest.mark.parametrize("cell", [False, True])
def test_elements_of_a_matlab_structure_and_cells_are_trials(tmp_path: Path, cell: bool) -> None:
    """They held no signal."""
    array: np.ndarray
    if cell:
        array = np.empty(3, dtype=object)
        array[:] = trials()
    else:
        array = np.zeros(3, dtype=[(name, "O") for name in trials()[0]])
        for number, trial in enumerate(trials()):
            array[number] = tuple(trial.values())
    told, tables, _ = session_of(matlab(tmp_path, runs=array), tmp_path / "session")
    assert [trial["label"] for trial in told] == ["runs 1", "runs 2", "runs 3"]
    assert tables[1][:, 2] == pytest.approx(3 * trials()[1]["angle"], abs=1e-8)


@pytest.mark.parametrize("cell", [False, True])
def test_matrices_without_names_are_told_by_physics(tmp_path: Path, cell: bool) -> None:
    tables = [np.column_stack([*trial.values()]) for trial in trials()]
    array = np.empty(3, dtype=object)
    array[:] = tables
    numbered = {f"run{number}": table for number, table in enumerate(tables)}
    log = matlab(tmp_path, **({"x": array} if cell else numbered))
    found = {belief.channel.name: belief for belief in believe(log)}
    assert {len(channel.values) for channel in log.channels} == {sum(LENGTHS)}
    assert list(found) == [f"column {number}" for number in (1, 2, 3, 4)]
    assert (found["column 1"].quantity, found["column 4"].quantity) == ("time", "velocity")


def test_cells_side_by_side_are_trials(tmp_path: Path) -> None:
    cells = {name: np.empty(3, dtype=object) for name in trials()[0]}
    for number, trial in enumerate(trials()):
        for name, values in trial.items():
            cells[name][number] = values
    told, tables, _ = session_of(matlab(tmp_path, **cells), tmp_path / "session")
    assert [trial["label"] for trial in told] == ["trial 1", "trial 2", "trial 3"]
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, cell in cells.items():
            for number, values in enumerate(cell):
                file[f"#refs#/{name}{number}"] = values[None, :]
            file[name] = [file[f"#refs#/{name}{number}"].ref for number in range(3)]
            file[name].attrs["MATLAB_class"] = np.bytes_("cell")
    of_7_3 = read_hdf5(tmp_path / "log.h5", kind="MATLAB")
    assert all(map(np.array_equal, tables, session_of(of_7_3, tmp_path / "7.3")[1]))


def test_cells_within_a_cell_are_trials_in_its_order(tmp_path: Path) -> None:
    """They were taken for cells side by side: all clocks for the first trial."""
    outer = np.empty(3, dtype=object)
    for number, trial in enumerate(trials()):
        outer[number] = np.empty(len(trial), dtype=object)
        outer[number][:] = [*trial.values()]
    log = matlab(tmp_path, runs=outer)
    assert log.channels[0].trials == (("runs 1", 0), ("runs 2", 300), ("runs 3", 720))
    assert len(log.channels) == 4


def test_trials_of_several_days_are_in_order(tmp_path: Path) -> None:
    days = {f"day{day}/trial{n}": trial for day in (1, 2) for n, trial in enumerate(trials())}
    told, _, _ = session_of(hdf5(tmp_path, days), tmp_path / "session")
    assert [trial["label"] for trial in told] == [
        f"day{day} trial{number}" for day in (1, 2) for number in range(3)
    ]


def test_a_group_in_brackets_is_no_column_of_a_matrix(tmp_path: Path) -> None:
    log = hdf5(tmp_path, {f"trial{n}/[arm]": trial for n, trial in enumerate(trials())})
    assert log.channels[0].name == "[arm].angle"


@pytest.mark.parametrize("kind", [str, np.bytes_])
def test_a_unit_beside_a_data_set_is_read(tmp_path: Path, kind: type) -> None:
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, unit in (("q", kind("deg")), ("dq", kind("deg/s"))):
            file[name] = np.sin(np.arange(100.0))
            file[name].attrs["units"] = unit
    found = believe(read_log(tmp_path / "log.h5"))
    assert sorted(belief.unit for belief in found) == ["deg", "deg/s"]


@pytest.mark.parametrize("cell", [False, True])
def test_matlab_7_3_refers_to_the_elements(tmp_path: Path, cell: bool) -> None:
    with h5py.File(tmp_path / "log.h5", "w") as file:
        references = np.empty((4, 3) if not cell else 3, dtype=h5py.ref_dtype)
        for number, trial in enumerate(trials()):
            for at, (name, values) in enumerate(trial.items()):
                file[f"#refs#/{number}/{name}"] = values[None, :]
                if not cell:
                    references[at, number] = file[f"#refs#/{number}/{name}"].ref
            if cell:
                references[number] = file[f"#refs#/{number}"].ref
        if cell:
            file["runs"] = references
            file["runs"].attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            for at, name in enumerate(trials()[0]):
                file[f"runs/{name}"] = references[at, :, None]
        file["who"] = np.frombuffer(b"P01", dtype=np.uint8).astype(np.uint16)
        file["who"].attrs["MATLAB_class"] = np.bytes_("char")
    log = read_log(tmp_path / "log.h5")
    assert sorted(channel.name for channel in log.channels) == ["angle", "time", "torque", "x"]
    assert log.channels[0].trials == (("runs 1", 0), ("runs 2", 300), ("runs 3", 720))


def test_a_group_within_itself_and_links_out_of_a_file_are_not_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["robot/q"] = np.arange(50.0)
        file["robot/again"] = file["robot"]
        file["robot/out"] = h5py.ExternalLink("/etc/passwd", "/")
    assert [channel.name for channel in read_log(tmp_path / "log.h5").channels] == ["robot.q"]


def test_stretches_are_cut_where_a_clock_begins_anew_and_where_trials_do() -> None:
    time = np.array([0.0, 1.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0])
    assert stretches(time, [3]) == [slice(0, 3), slice(3, 8)]
    assert stretches(np.concatenate([time, time + 50.0, time]), [8, 30]) == [
        *(slice(0, 8), slice(8, 16), slice(16, 24))
    ]


def numbered(form: str, samples: int | None = None) -> dict[str, np.ndarray]:
    """Return the signals of all trials as variables of names such as t1, q1, v1 and tau1."""
    names = {"time": "t", "angle": "q", "x": "v", "torque": "tau"}
    return {
        form.format(names[name], number): values[:samples]
        for number, trial in enumerate(trials(), start=1)
        for name, values in trial.items()
    }


@pytest.mark.parametrize("samples", [None, 200])
@pytest.mark.parametrize("form", ["{0}{1}", "{0}_{1}", "{0}_run{1}", "trial{1}_{0}"])
def test_variables_numbered_with_their_clocks_are_trials(
    tmp_path: Path, form: str, samples: int | None
) -> None:
    """They were taken for joints, of which all but those of one clock were left out."""
    told, tables, remarks = session_of(
        matlab(tmp_path, **numbered(form, samples)), tmp_path / "session"
    )
    assert [trial["label"] for trial in told] == ["trial 1", "trial 2", "trial 3"]
    for table, trial in zip(tables, trials(), strict=True):
        assert table[:, 2] == pytest.approx(trial["torque"][:samples], abs=1e-8)
    assert not any("left out" in remark for remark in remarks)


def test_joints_numbered_within_trials_stay_joints(tmp_path: Path) -> None:
    content = {}
    for number, trial in enumerate(trials(), start=1):
        content[f"time_{number}"] = trial["time"]
        content[f"q1_{number}"], content[f"q2_{number}"] = trial["angle"], 2 * trial["angle"]
        content[f"tau_{number}"] = np.column_stack([trial["torque"], trial["x"]])
    log = matlab(tmp_path, **content)
    assert [c.name for c in log.channels] == ["time", "q1", "q2", "tau[0]", "tau[1]"]
    assert {len(c.values) for c in log.channels} == {sum(LENGTHS)}


@pytest.mark.parametrize(
    "form", ["{0}_joint{1}", "motor{1}_{0}", "{0}{1} [sensor]", "{0}x{1}_", "J{1}.{0}"]
)
def test_what_names_parts_numbers_no_trials(tmp_path: Path, form: str) -> None:
    log = log_of("MATLAB", numbered(form).items())
    assert len(log.channels) == 12 and not log.remarks


def test_one_clock_of_numbered_joints_numbers_no_trials(tmp_path: Path) -> None:
    signals = numbered("{0}{1}", 200)
    del signals["t2"], signals["t3"]
    assert len(log_of("MATLAB", signals.items()).channels) == 10


def test_columns_of_a_table_are_trials_only_if_they_end_at_different_lines(tmp_path: Path) -> None:
    """Lines are of one moment: drives may have a clock each."""

    def read(signals: Mapping[str, np.ndarray]) -> Log:
        length = max(map(len, signals.values()))
        cells = [
            [f"{v[n]:.6f}" if n < len(v) else "" for v in signals.values()] for n in range(length)
        ]
        lines = [";".join(row) for row in [[*signals], *cells]]
        (tmp_path / "log.csv").write_text("\n".join(lines))
        return read_log(tmp_path / "log.csv")

    assert len(read(numbered("{0}{1}", 200)).channels) == 12
    short = numbered("{0}{1}", 200) | {"emg1": np.arange(190.0), "emg2": np.arange(180.0)}
    assert len(read(short).channels) == 14
    empty = {"f1": np.full(300, np.nan), "f2": np.full(300, np.nan)}
    assert len(read(numbered("{0}{1}") | empty).channels) == 4
    units = {"t": "s", "q": "rad", "v": "rad/s", "tau": "Nm"}
    with_units = {
        f"{name} [{units[name[:-1]]}]": values for name, values in numbered("{0}{1}").items()
    }
    told, tables, _ = session_of(read(with_units), tmp_path / "session")
    assert [len(table) for table in tables] == [*LENGTHS]
    assert [trial["label"] for trial in told] == ["trial 1", "trial 2", "trial 3"]


def test_trials_of_many_subjects_are_joined_in_one_pass_for_each_depth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time, rng = 0.01 * np.arange(40), np.random.default_rng(0)
    subjects, blocks = 12, 3
    arrays = [
        (f"all/{subject}/blocks/{block}/{name}", time if name == "time" else rng.normal(size=40))
        for subject in range(1, 1 + subjects)
        for block in range(1, 1 + blocks)
        for name in ("time", "score", "rank")
    ]
    passes = []
    once = joining._trials_in
    monkeypatch.setattr(joining, "_trials_in", lambda log: passes.append(1) or once(log))
    log = log_of("MATLAB", arrays)
    assert sorted(channel.name for channel in log.channels) == ["rank", "score", "time"]
    assert {len(channel.values) for channel in log.channels} == {40 * subjects * blocks}
    assert len(passes) <= 3
    assert len(log.remarks) == 2


def test_results_without_a_clock_are_given_up_at_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    arrays = [(f"all/{n}/{name}", rng.normal(size=40)) for n in range(1, 31) for name in "abc"]
    asked = []
    once = joining._clock
    monkeypatch.setattr(joining, "_clock", lambda channels: asked.append(1) or once(channels))
    log = log_of("MATLAB", arrays)
    assert len(log.channels) == 90 and len(asked) == 1
