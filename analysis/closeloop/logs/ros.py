"""ROS bags (1, 2 and MCAP) by `rosbags`: joint states by name, other messages by their numbers."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.belief import STATE_UNITS, WANTED
from analysis.closeloop.logs.log import Channel, Log

JOINT_STATE = "sensor_msgs/msg/JointState"
#: Numbers of one message of another kind that become channels: more is a picture or a map.
MAX_NUMBERS = 40
#: Topics without a signal that are told, where no other has one.
TOLD = 20


def read(path: Path) -> Log:
    """Read a bag: a folder with `metadata.yaml`, a `.bag`, or an `.mcap` or `.db3` of its own.

    The clock of a message is its header's stamp, or where it has none the time of recording.

    Raises:
        SessionError: the bag is damaged, or holds no message with numbers.
        ModuleNotFoundError: rosbags is missing.
    """
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from rosbags.typesys import Stores, get_typestore

    found: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    tables: dict[str, list[np.ndarray]] = defaultdict(list)
    failed: dict[str, str] = {}
    large: dict[str, str] = {}
    kinds: dict[str, str] = {}
    count: dict[str, int] = defaultdict(int)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection, recorded, raw in reader.messages():
                if connection.topic in failed:
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception as error:  # a foreign type may fail in any way
                    why = f"{connection.msgtype}: {error}"
                    failed[connection.topic] = f"{why}, after {count[connection.topic]} messages"
                    continue
                count[connection.topic] += 1
                kinds[connection.topic] = connection.msgtype
                if connection.msgtype != JOINT_STATE and (columns := table_of(message)):
                    for name, values in columns.items():
                        tables[f"{_dotted(connection.topic)}.{name}"].append(values)
                    continue
                time = _stamp(message) or 1e-9 * recorded
                topic = connection.topic if connection.msgtype == JOINT_STATE else ""
                numbers = _numbers(message, connection.msgtype, connection.topic)
                if not topic and len(numbers) > MAX_NUMBERS:
                    large[connection.topic] = connection.msgtype
                    continue
                for name, value in numbers:
                    found[topic, name].append((time, value))
    except (AnyReaderError, Error1, Error2) as error:
        why = " ".join(str(error).split())[:200]
        raise SessionError(f"is no ROS bag that can be read: {why}", file=path.name) from None
    log = Log(kind="ROS bag")
    states = {topic for topic, _ in found if topic}
    best = max(sorted(states), key=lambda topic: _rank(topic, found), default="")
    for topic in sorted(states - {best}):
        log.remarks.append(f"{topic} holds joint states, too, and was left out beside {best}")
    for (topic, name), samples in found.items():
        if topic in (best, "") and len(samples) >= 2:
            table = np.array(samples)
            unit = STATE_UNITS.get(name.rpartition(".")[2])
            log.channels.append(Channel(name=name, time=table[:, 0], values=table[:, 1], unit=unit))
    log.channels += [
        Channel(name=name, values=np.concatenate(parts)) for name, parts in tables.items()
    ]
    log.remarks += [
        f"{topic} ({kind}) has messages of more than {MAX_NUMBERS} numbers, which were left out"
        for topic, kind in large.items()
    ]
    if not log.channels and (others := count.keys() - large.keys()):
        some = sorted(others)[:TOLD]
        there = ", ".join(f"{topic} ({kinds[topic]}, {count[topic]} in all)" for topic in some)
        log.remarks.append(f"no topic has two messages with numbers: {there}")
    log.remarks += [f"{topic} could not be read ({why})" for topic, why in failed.items()]
    return log


def _rank(
    topic: str, found: Mapping[tuple[str, str], Sequence[tuple[float, float]]]
) -> tuple[bool, int, int]:
    """Return what the topic of measured joint states has most of: efforts, then all samples.

    Before that comes one whose name does not say that it is what was wanted.
    """
    wanted = any(word in WANTED for word in re.findall("[a-z]+", topic.lower()))
    own = {name: len(samples) for (other, name), samples in found.items() if other == topic}
    efforts = sum(count for name, count in own.items() if name.endswith(".effort"))
    return not wanted, efforts, sum(own.values())


def _stamp(message: Any) -> float | None:
    """Return the header's time, s; None if there is none or it was never set."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    seconds = float(stamp.sec) + 1e-9 * float(getattr(stamp, "nanosec", 0))
    return seconds if seconds > 0.0 else None


def _numbers(message: Any, kind: str, topic: str) -> list[tuple[str, float]]:
    """Return the numbers of one message with their channels' names."""
    if kind == JOINT_STATE:
        return [
            (f"{joint}.{quantity}", float(values[at]))
            for quantity in STATE_UNITS
            if len(values := getattr(message, quantity)) == len(message.name)
            for at, joint in enumerate(message.name)
        ]
    return _flat(message, _dotted(topic))


def _dotted(topic: str) -> str:
    return topic.lstrip("/").replace("/", ".")


def table_of(message: Any) -> dict[str, np.ndarray]:
    """Return the columns of a message that holds many samples at once; empty if it does not.

    They are equally long arrays, of which one is a clock or counts: a scan's does not go one way.
    """
    arrays = {
        key: value.astype(float)
        for key in getattr(message, "__dataclass_fields__", {})
        if isinstance(value := getattr(message, key), np.ndarray) and value.dtype.kind in "fiu"
    }
    lengths = {len(values) for values in arrays.values()}
    if len(arrays) < 2 or len(lengths) != 1 or max(lengths) <= MAX_NUMBERS:
        return {}
    counts = any(
        values[0] < values[-1] and np.all(np.diff(values) >= 0) for values in arrays.values()
    )
    return arrays if counts else {}


def _flat(item: Any, name: str) -> list[tuple[str, float]]:
    if isinstance(item, bool | int | float | np.number):
        return [(name, float(item))]
    if isinstance(item, np.ndarray) and item.dtype.kind in "fiub":
        return [(f"{name}[{at}]", float(x)) for at, x in enumerate(item[: MAX_NUMBERS + 1].flat)]
    fields = getattr(item, "__dataclass_fields__", None)
    if fields is None:
        return []
    return [
        pair
        for key in fields
        if key not in ("header", "stamp", "__msgtype__")
        for pair in _flat(getattr(item, key), f"{name}.{key}")
    ]
