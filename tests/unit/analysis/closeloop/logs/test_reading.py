"""Logs of every kind are read into named channels; a damaged one is one sentence."""

import os
from dataclasses import fields, make_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs import numpy_archive, ros
from analysis.closeloop.logs.reading import read_log

N = 120


def names(path: Path) -> list[str]:
    return [channel.name for channel in read_log(path).channels]


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), (" ", "."), ("|", ".")],
)
def test_text_with_any_separator(tmp_path: Path, separator: str, decimal: str) -> None:
    rows = [f"0.{n:03}{separator}{n}.5".replace(".", decimal) for n in range(N)]
    (tmp_path / "log.txt").write_text(f"t{separator}angle\n" + "\n".join(rows) + "\n")
    time, angle = read_log(tmp_path / "log.txt").channels
    assert (time.name, angle.name) == ("t", "angle")
    assert time.values[-1] == pytest.approx(0.119) and angle.values[-1] == N - 0.5


def test_a_file_cut_in_the_middle_of_a_line_loses_that_line_and_says_so(tmp_path: Path) -> None:
    text = "t,q\n" + "".join(f"{n / 100},{n}\n" for n in range(N)) + "1.2"
    (tmp_path / "log.csv").write_text(text)
    log = read_log(tmp_path / "log.csv")
    assert len(log.channels[0].values) == N
    assert "1 of 122 lines" in log.remarks[0]


def test_empty_cells_are_missing_samples_and_text_columns_are_named(tmp_path: Path) -> None:
    text = "t,q,state\n" + "".join(f"{n},{'' if n == 7 else n},run\n" for n in range(N))
    (tmp_path / "log.csv").write_text(text)
    log = read_log(tmp_path / "log.csv")
    assert np.isnan(log.channels[1].values[7])
    assert log.remarks == ["state holds no numbers, but 'run', and was left out"]


def test_a_matlab_file_with_structures(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "log.mat", {"t": np.arange(N), "robot": {"q": np.ones((3, N)), "n": "x"}})
    assert names(tmp_path / "log.mat") == ["t", "robot.q[0]", "robot.q[1]", "robot.q[2]"]


def test_hdf5_and_matlab_7_3(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra logs")
    for name, block in (("log.h5", 0), ("log.mat", 512)):
        with h5py.File(tmp_path / name, "w", userblock_size=block) as file:
            file["robot/q"] = np.ones((N, 2))
            file["note"] = "not a number"
        if block:
            with (tmp_path / name).open("r+b") as raw:
                raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        assert names(tmp_path / name) == ["robot.q[0]", "robot.q[1]"]


def write_bag(path: Path, *, ros1: bool = False, mcap: bool = False, wanted: bool = False) -> None:
    """Write 100 joint states of two joints, every tenth second a temperature beside them.

    Where they are `wanted`, what a controller asked for is a topic of its own, 0.5 rad off.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    types: dict[str, Any] = store.types
    state, number = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
    encode = store.serialize_ros1 if ros1 else store.serialize_cdr
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        joints = writer.add_connection("/joint_states", state, typestore=store)
        heat = writer.add_connection("/motor/heat", number, typestore=store)
        commands = writer.add_connection("/joint_command", state, typestore=store)
        for n in range(100):
            time = types["builtin_interfaces/msg/Time"](sec=1000 + n // 50, nanosec=n % 50 * 10**7)
            more = {"seq": n} if ros1 else {}
            header = types["std_msgs/msg/Header"](stamp=time, frame_id="", **more)
            q = np.array([0.01 * n, -0.01 * n])
            message = types[state](
                header=header, name=["elbow", "wrist"], position=q, velocity=q, effort=np.array([])
            )
            at = 1_000_000_000_000 + n * 20_000_000
            writer.write(joints, at, encode(message, state))
            if wanted:
                asked = replace(message, position=q + 0.5)
                writer.write(commands, at + 5_000_000, encode(asked, state))
            if n % 10 == 0:
                writer.write(heat, at, encode(types[number](data=20.0 + n), number))


@pytest.mark.parametrize("kind", ["ros1", "ros2", "ros2 file", "mcap folder", "mcap file"])
def test_bags_of_ros_1_ros_2_and_mcap(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags", reason="needs the extra logs")
    path = tmp_path / ("log.bag" if kind == "ros1" else "log")
    write_bag(path, ros1=kind == "ros1", mcap=kind.startswith("mcap"))
    alone = {"mcap file": "log.mcap", "ros2 file": "log.db3"}
    log = read_log(path / alone.get(kind, ""))
    found = {channel.name: channel for channel in log.channels}
    assert list(found) == [
        *("elbow.position", "wrist.position", "elbow.velocity", "wrist.velocity"),
        "motor.heat.data",
    ]
    elbow = found["elbow.position"]
    assert elbow.time is not None and elbow.unit == "rad"
    assert elbow.time[51] - elbow.time[50] == pytest.approx(0.01)  # the header's, not the bag's
    assert len(found["motor.heat.data"].values) == 10


def test_what_was_measured_is_not_mixed_with_what_a_controller_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra logs")
    write_bag(tmp_path / "log", wanted=True)
    log = read_log(tmp_path / "log")
    elbow = next(channel for channel in log.channels if channel.name == "elbow.position")
    assert elbow.values == pytest.approx(0.01 * np.arange(100))
    assert log.remarks == [
        "/joint_command holds joint states, too, and was left out beside /joint_states"
    ]


def test_a_bag_of_long_messages_alone_is_told_by_their_topic_and_kind(tmp_path: Path) -> None:
    """As of a PR2 whose every message holds a whole movement."""
    pytest.importorskip("rosbags", reason="needs the extra logs")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "std_msgs/msg/Float64MultiArray"
    types: dict[str, Any] = store.types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    message = types[kind](layout=layout, data=np.arange(500.0))
    with Writer(tmp_path / "log", version=9) as writer:
        segments = writer.add_connection("/segments", kind, typestore=store)
        for n in range(3):
            writer.write(segments, n, store.serialize_cdr(message, kind))
    with pytest.raises(
        SessionError, match=r"no signal.*/segments \(std_msgs.*more than 40 numbers"
    ):
        read_log(tmp_path / "log")


def test_a_bag_of_one_message_is_told_by_its_topic_and_kind(tmp_path: Path) -> None:
    """As of a planned trajectory: it was said to have no column of two numbers, and no more."""
    pytest.importorskip("rosbags", reason="needs the extra logs")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "trajectory_msgs/msg/JointTrajectory"
    types: dict[str, Any] = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    message = types[kind](header=header, joint_names=["elbow"], points=[])
    with Writer(tmp_path / "log", version=9) as writer:
        plan = writer.add_connection("/arm_controller/joint_trajectory", kind, typestore=store)
        writer.write(plan, 1, store.serialize_cdr(message, kind))
    with pytest.raises(
        SessionError,
        match=r"two messages .*: /arm_.*y \(traj.*Trajectory, 1 in all\)",
    ):
        read_log(tmp_path / "log")


def test_a_message_of_equally_long_arrays_is_a_table_if_one_of_them_counts() -> None:
    """A PR2's messages held a second each: tick, milliseconds, position, velocity and torque."""
    n = np.arange(50.0)
    kind = make_dataclass("Chunk", ["tick", "position", "name"])
    table = ros.table_of(kind(tick=n, position=np.sin(n), name="pan"))
    assert [*table] == ["tick", "position"] and len(table["position"]) == 50
    scan = make_dataclass("Scan", ["ranges", "intensities"])
    assert ros.table_of(scan(ranges=np.sin(n), intensities=np.cos(n))) == {}
    assert ros.table_of(kind(tick=n, position=n[:-1], name="pan")) == {}
    assert ros.table_of(kind(tick=n[:9], position=n[:9], name="pan")) == {}


def test_tables_of_a_bag_follow_each_other(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra logs")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/LaserScan"
    types: dict[str, Any] = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    numbers = {field.name: 0.0 for field in fields(types[kind]) if "_" in field.name}
    with Writer(tmp_path / "log", version=9) as writer:
        topic = writer.add_connection("/pan/data", kind, typestore=store)
        for at in range(3):
            # No other message of the standard has two such arrays.
            tick = np.arange(50, dtype=np.float32) + 50 * at
            given = {**numbers, "header": header, "ranges": tick, "intensities": np.sin(tick)}
            given.pop("__msgtype__", None)
            writer.write(topic, at, store.serialize_cdr(types[kind](**given), kind))
    found = {channel.name: channel for channel in read_log(tmp_path / "log").channels}
    assert [*found] == ["pan.data.ranges", "pan.data.intensities"]
    assert np.array_equal(found["pan.data.ranges"].values, np.arange(150.0))
    assert found["pan.data.ranges"].time is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_named_pipe_is_no_file_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.csv")
    with pytest.raises(SessionError, match="is no file"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("log.csv", b"two lines\nof prose\n", "holds no signal"),
        ("log.csv", b"", "fewer than two lines"),
        ("log.csv", b"t,q\n\x00\x00\n", "zero bytes"),
        ("log.csv", b"hello\nworld\n", "holds no signal"),
        ("log.mat", b"nothing of the kind" * 20, "MATLAB"),
        ("log.h5", b"nothing", "HDF5"),
        ("log.bag", b"nothing", "ROS bag"),
        ("log.mcap", b"nothing", "ROS bag"),
        ("log.mcap", b"\x89MCAP0\r\n", "damaged"),
        ("log.db3", b"nothing", "ROS bag"),
        ("log.pdf", b"nothing", "ends in none of"),
    ],
)
def test_a_damaged_file_is_one_sentence_with_its_name(
    tmp_path: Path, name: str, content: bytes, word: str
) -> None:
    pytest.importorskip("rosbags", reason="needs the extra logs")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SessionError) as refused:
        read_log(tmp_path / name)
    assert word in str(refused.value) and name in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_and_a_folder_that_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="does not exist"):
        read_log(tmp_path / "log.csv")
    with pytest.raises(SessionError, match=r"metadata\.yaml"):
        read_log(tmp_path)


def test_decimal_commas_without_a_header(tmp_path: Path) -> None:
    rows = [f"0,{n:03};{n},5" for n in range(N)]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    time, angle = read_log(tmp_path / "log.csv").channels
    assert len(time.values) == N and angle.values[-1] == N - 0.5


def test_a_line_of_units_below_the_header_goes_to_the_names(tmp_path: Path) -> None:
    rows = [f"{n / 100},{n},{n}" for n in range(N)]
    (tmp_path / "log.csv").write_text("t,angle,torque\ns,deg,Nm\n" + "\n".join(rows))
    log = read_log(tmp_path / "log.csv")
    assert [channel.name for channel in log.channels] == ["t [s]", "angle [deg]", "torque [Nm]"]
    assert len(log.channels[0].values) == N and "units" in log.remarks[0]


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
def test_text_as_office_programs_write_it(tmp_path: Path, encoding: str) -> None:
    rows = [f"{n / 100};{n}" for n in range(N)]
    (tmp_path / "log.csv").write_bytes(("t;Winkel [°]\r\n" + "\r\n".join(rows)).encode(encoding))
    assert names(tmp_path / "log.csv") == ["t", "Winkel [°]"]


def test_comments_at_the_top_and_a_header_among_them(tmp_path: Path) -> None:
    rows = [f"{n / 100},{n}" for n in range(N)]
    (tmp_path / "log.csv").write_text("# robot 7\n# t,angle\n" + "\n".join(rows))
    assert names(tmp_path / "log.csv") == ["t", "angle"]


def test_a_small_file_that_declares_gigabytes_is_refused_at_once(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra logs")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("q", shape=(10**9,), dtype="f8", chunks=True)
        file["nothing"] = h5py.Empty("f8")
    with pytest.raises(SessionError, match="at most 50000000"):
        read_log(tmp_path / "log.h5")


def test_a_damaged_matlab_file_is_one_sentence(tmp_path: Path) -> None:
    from scipy.io import savemat

    rng = np.random.default_rng(0)
    savemat(tmp_path / "log.mat", {"q": rng.normal(size=5000)}, do_compression=True)
    raw = bytearray((tmp_path / "log.mat").read_bytes())
    raw[1000:1050] = bytes(50)
    (tmp_path / "log.mat").write_bytes(raw)
    with pytest.raises(SessionError, match=r"log\.mat"):
        read_log(tmp_path / "log.mat")


@pytest.mark.parametrize(
    ("array", "mark"), [("[{}, {}]", ","), ("[{} {}]", ","), ("({}, {})", ","), ("[{}, {}]", ";")]
)
def test_a_cell_that_holds_an_array_is_a_column_for_each_of_its_numbers(
    tmp_path: Path, array: str, mark: str
) -> None:
    """Recorders write all joints' positions into one cell; they were left out as no numbers."""
    lines = [mark.join(["kind", "timestamp", "positions", "torques"])]
    for n in range(N):
        cells = [array.format(0.1 * n, -0.2 * n), array.format(n % 7, 1e-3 * n)]
        lines.append(mark.join(["STATE", f"{0.01 * n}", *(f'"{cell}"' for cell in cells)]))
    lines[5] = lines[5].replace("STATE", "").replace("]", "")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    assert [channel.name for channel in log.channels] == [
        *("timestamp", "positions[0]", "positions[1]", "torques[0]", "torques[1]")
    ]
    assert log.channels[2].values[10] == pytest.approx(-2.0)
    assert log.remarks == ["kind holds no numbers, but 'STATE', and was left out"]


def test_text_that_only_looks_like_an_array_is_none(tmp_path: Path) -> None:
    text = "t,q,state\n" + "".join(f'{n},{n},"[run, {n}]"\n' for n in range(N))
    (tmp_path / "log.csv").write_text(text)
    log = read_log(tmp_path / "log.csv")
    assert [channel.name for channel in log.channels] == ["t", "q"]
    assert log.remarks == ["state holds no numbers, but '[run, 0]', and was left out"]


@pytest.mark.parametrize(
    "form", ["Time: {} Position: {} Current: {}", "Time={}, Position={}, Current={};"]
)
def test_labels_before_numbers_are_the_names_of_columns(tmp_path: Path, form: str) -> None:
    lines = [form.format(5000 + 3 * n, 500 - n, -0.5 * n) for n in range(80)]
    cut = ["sition: 12 Current: 3", *lines, lines[0][:20]]
    (tmp_path / "log.txt").write_text("\n".join(cut))
    log = read_log(tmp_path / "log.txt")
    assert [channel.name for channel in log.channels] == ["Time", "Position", "Current"]
    assert [len(channel.values) for channel in log.channels] == [80] * 3
    assert [channel.values[2] for channel in log.channels] == [5006.0, 498.0, -1.0]
    assert log.remarks == ["2 lines have other labels than most and were left out"]


def test_stamps_with_colons_are_no_labels(tmp_path: Path) -> None:
    lines = [f"12:00:{n % 60:02d}, {n}, {n * n}" for n in range(60)]
    (tmp_path / "log.txt").write_text("\n".join(["t,a,b", *lines]))
    assert [c.name for c in read_log(tmp_path / "log.txt").channels] == ["t", "a", "b"]


def test_arrays_of_an_archive_are_channels_and_objects_are_never_run(tmp_path: Path) -> None:
    time = 0.01 * np.arange(90)
    joint = np.column_stack([np.sin(time), np.cos(time)])
    anything = np.array([{"a": 1}, None], dtype=object)
    np.savez(tmp_path / "log.npz", time=time, joint=joint, notes=anything)
    log = read_log(tmp_path / "log.npz")
    assert log.kind == "NumPy"
    assert [channel.name for channel in log.channels] == ["time", "joint[0]", "joint[1]"]
    assert np.array_equal(log.channels[2].values, joint[:, 1])
    assert log.remarks == ["notes holds no numbers, but objects, and was left out"]


def test_an_archive_that_unpacks_to_more_than_a_log_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez_compressed(tmp_path / "log.npz", zeros=np.zeros(4000))
    monkeypatch.setattr(numpy_archive, "MAX_BYTES", 20_000)
    with pytest.raises(SessionError, match="at most 20000"):
        read_log(tmp_path / "log.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(SessionError, match="is no archive of arrays"):
        read_log(tmp_path / "text.npz")
