"""Trials in one file: groups, elements of a structure, or numbered names, of the same signals."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from analysis.closeloop.logs.belief import by_name
from analysis.closeloop.logs.clock import find_clock
from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.unit_names import split_unit
from intake.xml import listed

#: Words for what a movement that is recorded once more is called.
TRIALS = {
    *("trial", "run", "rep", "repetition", "take", "test", "measurement", "recording", "session"),
    *("experiment", "versuch", "messung", "essai"),
}
#: Words for what a robot has several of at one time.
PARTS = {
    *("joint", "axis", "motor", "drive", "link", "sensor", "imu", "plate", "marker", "channel"),
    *("device", "j"),
}
#: Names of signals of which each is there once for each trial: `run2_q`, and `q2` or `q_run2`.
NUMBERED = [
    re.compile(rf"(?:{'|'.join(TRIALS)})[\W_]*(?P<trial>\d+)[\W_]+(?P<signal>.+)", re.IGNORECASE),
    re.compile(
        rf"(?P<signal>.+?)(?:[\W_]+(?:{'|'.join(TRIALS)}))?[\W_]*(?P<trial>\d+)", re.IGNORECASE
    ),
]
#: Channels by their place in a file, `run_1`, and by name within it.
Places = dict[str, dict[str, Channel]]


def join_trials(log: Log) -> None:
    """Join the signals that a log has once for each trial, in place; names are paths with `/`.

    Places with numbers in their names are trials if each has a clock, or if they are called so;
    others, if each has a clock that no other has, a position and an effort. Where names are
    numbered, clocks too, the numbers are those of trials.
    """
    while found := _numbered(log) or _trials_in(log):
        for parent, places in found:
            _join(log, parent, places)


def _join(log: Log, parent: str, places: Places) -> None:
    """Join the signals of places that are trials, below one parent, in place."""
    common = _common(places)
    gone = {channel.name for place in places.values() for channel in place.values()}
    left = [
        channel.name
        for place in places.values()
        for name, channel in place.items()
        if name not in common
    ]
    if left:
        log.remarks.append(f"not every trial has {listed(left)}, and they were left out")
    labels = {place: _label(parent or "trial", place) for place in places}
    told = [
        f"{labels[place]} ({len(next(iter(signals.values())).values)} samples)"
        for place, signals in places.items()
    ]
    remark = f"{len(places)} trials hold the same signals: {listed(told)}"
    if remark not in log.remarks:
        log.remarks.append(remark)
    kept = [channel for channel in log.channels if channel.name not in gone]
    # What only numbers elements is no part of a signal's name.
    above = parent[: parent.rstrip("/").rfind("/") + 1]
    taken = {channel.name for channel in kept}
    if not all(map(str.isdigit, places)) or any(f"{above}{name}" in taken for name in common):
        above = parent
    log.channels = kept + [
        _joined(_named(f"{above}{name}"), {labels[p]: places[p][name] for p in places})
        for name in common
    ]


def _common(places: Places) -> list[str]:
    """Return the names that all places have."""
    first, *others = places.values()
    return [name for name in first if all(name in other for other in others)]


def _named(path: str) -> str:
    """Return the path of a channel; a column of matrices without a name is `column 3`."""
    column = re.fullmatch(r"\[(\d+)\]", path)
    return f"column {int(column[1]) + 1}" if column else path


def _numbered(log: Log) -> list[tuple[str, Places]]:
    """Return the first place in which t1, q1 and tau1, t2, q2 and tau2 are trials, and these.

    Joints share a clock; what has one for each number numbers trials. But the lines of a table are
    of one moment, unless its columns end at different ones.
    """
    table = log.kind == "CSV"
    below: dict[str, Places] = defaultdict(lambda: defaultdict(dict))
    for channel in log.channels:
        path, column = re.split(r"(?=/\[\d+\]$|$)", channel.name, maxsplit=1)
        parent, slash, last = ("", "", path) if table else path.rpartition("/")
        rest, unit, sure = split_unit(last)
        if found := next(filter(None, (form.fullmatch(rest.strip()) for form in NUMBERED)), None):
            unit = (f" [{unit}]" if sure else f"_{unit}") if unit else ""
            name = f"{found['signal']}{unit}{column}"
            below[f"{parent}{slash}"][found["trial"]][name] = _ended(channel) if table else channel
    for parent, places in below.items():
        timed = {n: place for n, place in places.items() if "time" in _quantities(place, place)}
        if len(timed) < 2 or None in [_clock([*place.values()]) for place in timed.values()]:
            continue
        ends = {
            len(channel.values)
            for place in timed.values()
            for name, channel in place.items()
            if "time" in _quantities(place, [name])
        }
        if table and len(ends) == 1:
            continue
        common = _common(timed)
        said = {q for place in timed.values() for q in _quantities(place, common)}
        parts = {word for name in common for word in re.findall("[a-z]+", name.lower())} & PARTS
        if {"time", "position"} <= said and said & {"effort", "current"} and not parts:
            return [(parent, dict(sorted(timed.items(), key=lambda item: int(item[0]))))]
    return []


def _quantities(place: dict[str, Channel], names: Iterable[str]) -> set[str]:
    """Return what signals of a place are by their names there."""
    return {by_name(replace(place[name], name=name)).quantity for name in names}


def _ended(channel: Channel) -> Channel:
    """Return a column of a table without the empty cells after its last number."""
    whole = np.flatnonzero(np.isfinite(channel.values))
    return replace(channel, values=channel.values[: whole[-1] + 1]) if len(whole) else channel


def _trials_in(log: Log) -> list[tuple[str, Places]]:
    """Return the deepest places below which others are trials, and these; names end in `/`.

    All of one depth at once: a file of 38 subjects with as many blocks each would be gone through
    anew for each of them.
    """
    if log.kind == "CSV":
        return []
    below: dict[str, Places] = defaultdict(lambda: defaultdict(dict))
    for channel in log.channels:
        parts = channel.name.split("/")
        for at in range(len(parts) - 1):
            parent = "".join(f"{part}/" for part in parts[:at])
            below[parent][parts[at]]["/".join(parts[at + 1 :])] = channel
    parents = sorted(below, key=lambda name: -name.count("/"))
    for _, alike in groupby(parents, key=lambda name: name.count("/")):
        if found := [(parent, own) for parent in alike if (own := _alike(parent, below[parent]))]:
            return found
    return []


def _alike(parent: str, below: Places) -> Places:
    """Return those places below a parent that are trials, in order; none if none are."""
    numbered: dict[str, Places] = defaultdict(dict)
    for place, signals in below.items():
        kind = re.sub(r"\d+", "#", place)
        numbered[kind if kind != place else ""][place] = signals
    for kind, places in numbered.items():
        if _are_trials(parent, kind, places):
            return dict(sorted(places.items(), key=lambda item: _order(item[0])))
    return {}


def _are_trials(parent: str, kind: str, places: Places) -> bool:
    """Whether places that hold signals are trials.

    Args:
        parent: below which they are.
        kind: their name with # for its numbers; empty if they have none.
        places: the places.
    """
    common = _common(places)
    # What has only numbers for names is called by what it is in.
    name = " ".join([_label(parent, place) for place in places]).lower()
    words = {form for word in re.findall("[a-z]+", name) for form in (word, word.removesuffix("s"))}
    if len(places) < 2 or not common or words & PARTS:
        return False
    if kind and words & TRIALS:
        return True
    clocks = []
    for place in places.values():
        # Of results without any clock, thousands of them, the first place says enough.
        if (clock := _clock([place[name] for name in common])) is None:
            return False
        clocks.append(clock)
    if kind:
        return True
    first = next(iter(places.values()))
    quantities = {by_name(first[name]).quantity for name in common}
    return {"position", "effort"} <= quantities and len({*clocks}) == len(clocks)


def _clock(channels: Sequence[Channel]) -> bytes | None:
    """Return the stamps of channels as bytes, to compare them; None if none of them is a clock."""
    lengths: dict[int, list[Channel]] = defaultdict(list)
    for channel in channels:
        lengths[len(channel.values)].append(channel)
    for alike in lengths.values():
        beliefs = [by_name(channel) for channel in alike]
        find_clock(beliefs, [*range(len(beliefs))])
        time = beliefs[0].channel.time
        if time is not None:
            return time.tobytes()
    return None


def _joined(name: str, trials: dict[str, Channel]) -> Channel:
    """Return one channel of those of one name, trial after trial."""
    begins, begin = [], 0
    for label, channel in trials.items():
        own = channel.trials or (("", 0),)
        begins += [(f"{label} {more}".strip(), begin + at) for more, at in own]
        begin += len(channel.values)
    values = np.concatenate([channel.values for channel in trials.values()])
    return replace(next(iter(trials.values())), name=name, values=values, trials=tuple(begins))


def _label(parent: str, place: str) -> str:
    """Return what to call a trial: an element of `runs` is `runs 3`."""
    return f"{parent.rstrip('/').rpartition('/')[2]} {place}".strip() if place.isdigit() else place


def _order(place: str) -> list[tuple[int, str]]:
    """Return what sorts trial_2 before trial_10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", place)]
