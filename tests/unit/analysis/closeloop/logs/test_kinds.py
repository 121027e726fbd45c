"""JSON, MATLAB's cells of samples and its objects, pickles, and logs without a clock."""

import json
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.inspection import believe, of_rates
from analysis.closeloop.logs.log import Log
from analysis.closeloop.logs.matlab import _of_objects
from analysis.closeloop.logs.reading import read_log

N = 120


def read(path: Path, content: object) -> Log:
    path.write_text(json.dumps(content))
    return read_log(path)


def test_json_of_lists_is_read_by_their_names(tmp_path: Path) -> None:
    time = [n / 100 for n in range(N)]
    log = read(tmp_path / "log.json", {"robot": "x", "t": time, "arm": {"q": [time, time]}})
    assert log.kind == "JSON" and [c.name for c in log.channels] == ["t", "arm.q[0]", "arm.q[1]"]


def test_json_of_samples_is_read_by_their_names(tmp_path: Path) -> None:
    """A stranger's motors: entries of one sample each, beside what the motor is."""
    entries = [{"position": n * 0.5, "load": n if n else None, "on": True} for n in range(N)]
    log = read(tmp_path / "log.json", {"mass": 1.13, "entries": entries})
    position, load, _ = log.channels
    assert position.name == "entries.position" and position.values[-1] == (N - 1) * 0.5
    assert np.isnan(load.values[0]) and load.values[-1] == N - 1


def test_json_of_trials_keeps_them_apart(tmp_path: Path) -> None:
    trials = [{"type": "a", "q": [float(n) for n in range(N + k)]} for k in range(2)]
    log = read(tmp_path / "log.json", {"data": trials})
    assert [(c.name, len(c.values)) for c in log.channels] == [("data.1.q", N), ("data.2.q", N + 1)]


@pytest.mark.parametrize("text", ["{", "[" * 100_000, '{"a": "b"}', "[]", "3"])
def test_json_that_is_damaged_or_holds_no_signal_is_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(SessionError, match=r"is no JSON|holds no signal"):
        read_log(tmp_path / "log.json")


def test_a_pickle_is_refused_and_says_why_and_how_to_save_instead(tmp_path: Path) -> None:
    (tmp_path / "log.pkl").write_bytes(pickle.dumps({"q": [1.0]}))
    with pytest.raises(SessionError, match="refused on purpose") as caught:
        read_log(tmp_path / "log.pkl")
    assert "numpy.savez" in str(caught.value)


def test_cells_of_one_sample_each_are_one_trial(tmp_path: Path) -> None:
    """A stranger's log had 7301 cells of six joints, and was 36506 channels."""
    from scipy.io import savemat

    cells = np.empty(N, dtype=object)
    for n in range(N):
        cells[n] = np.array([n, 2.0 * n, 3.0])
    savemat(tmp_path / "log.mat", {"t": np.arange(N) / 100, "q": cells})
    log = read_log(tmp_path / "log.mat")
    assert [c.name for c in log.channels] == ["t", "q[0]", "q[1]", "q[2]"]
    assert log.channels[2].values[-1] == 2.0 * (N - 1)


def test_cells_of_a_trial_each_stay_trials(tmp_path: Path) -> None:
    from scipy.io import savemat

    cells = np.empty(3, dtype=object)
    for n in range(3):
        cells[n] = np.arange(N) + 1000.0 * n
    savemat(tmp_path / "log.mat", {"q": cells})
    assert {len(c.values) for c in read_log(tmp_path / "log.mat").channels} != {3}


def test_an_object_of_matlab_says_how_to_save_what_it_holds() -> None:
    from scipy.io.matlab import MatlabOpaque

    kinds = [("s0", "O"), ("s1", "O"), ("s2", "O"), ("arr", "O")]
    table = MatlabOpaque(np.array([(b"arm", b"MCOS", b"table", 0)], dtype=kinds))
    (said,) = _of_objects({"None": table, "t": np.arange(3)})
    assert said.startswith("arm is a MATLAB table")
    assert "table2struct(arm, 'ToScalar', true)" in said


def test_an_object_in_matlab_7_3_says_it_too_and_is_no_signal(tmp_path: Path) -> None:
    """As a stranger's Simulink log: six numbers say where in the file its signals are."""
    h5py = pytest.importorskip("h5py", reason="needs the extra logs")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["data"] = np.array([[3707764736, 2, 1, 1, 1, 2]], dtype=np.uint32)
        file["data"].attrs["MATLAB_object_decode"] = np.int32(3)
        file["data"].attrs["MATLAB_class"] = np.bytes_(b"Simulink.SimulationData.Dataset")
    with pytest.raises(SessionError, match=r"data is a MATLAB Simulink.*extractTimetable\(data\)"):
        read_log(tmp_path / "log.h5")


def test_an_array_of_numpy_is_read_as_its_columns_or_its_fields(tmp_path: Path) -> None:
    np.save(tmp_path / "log.npy", np.ones((N, 2)))
    assert [c.name for c in read_log(tmp_path / "log.npy").channels] == ["data[0]", "data[1]"]
    table = np.ones(N, dtype=[("t", "f8"), ("q", "f4", (2,)), ("mode", "U4")])
    np.save(tmp_path / "log.npy", table)
    assert [c.name for c in read_log(tmp_path / "log.npy").channels] == ["t", "q[0]", "q[1]"]


def test_an_array_of_objects_is_a_pickle(tmp_path: Path) -> None:
    """As a stranger's dog: a dictionary that numpy.save was given."""
    np.save(tmp_path / "log.npy", np.array({"q": [1.0]}, dtype=object))
    with pytest.raises(SessionError, match="is a pickle"):
        read_log(tmp_path / "log.npy")


def test_what_scipy_warns_of_is_not_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import scipy.io
    from scipy.io.matlab import MatReadWarning

    def loadmat(*_: object, **__: object) -> dict[str, np.ndarray]:
        warnings.warn("Duplicate variable name", MatReadWarning, stacklevel=1)
        return {"q": np.arange(10.0)}

    scipy.io.savemat(tmp_path / "log.mat", {"q": np.arange(10.0)})
    monkeypatch.setattr(scipy.io, "loadmat", loadmat)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert read_log(tmp_path / "log.mat").channels[0].name == "q"
    assert not caught


def test_a_log_without_a_clock_that_tells_no_rate_asks_for_one(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    np.savetxt(tmp_path / "log.csv", rng.standard_normal((N, 3)), delimiter=",")
    log = read_log(tmp_path / "log.csv")
    (said,) = of_rates(log, believe(log))
    assert "no channel is a clock" in said and "give --rate HZ" in said
