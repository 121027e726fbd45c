"""Arrays as a log: a vector is one channel, a matrix one for each of its shorter side."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.logs.trials import join_trials

#: A matrix with more signals is no recording of joints.
MAX_SIGNALS = 200


def log_of(kind: str, arrays: Iterable[tuple[str, np.ndarray]]) -> Log:
    """Return the log of arrays by their paths, `run_1/elbow/q`, with trials joined."""
    named = [*arrays]
    if kind == "MATLAB":
        named = _side_by_side(named)
    log = Log(kind=kind, channels=_channels(named))
    join_trials(log)
    log.channels = [
        replace(channel, name=channel.name.replace("/[", "[").replace("/", "."))
        for channel in log.channels
    ]
    return log


def _side_by_side(arrays: Sequence[tuple[str, np.ndarray]]) -> list[tuple[str, np.ndarray]]:
    """Return arrays of which those in MATLAB's cells of one size are in places of their number.

    They belong together as the fields of a structure array's elements do: t{2} and q{2}, `t/2` and
    `q/2` here, become `2/t` and `2/q`. A name that is a number is that of a cell within a cell.
    """
    sizes = Counter(cell for path, _ in arrays if (cell := _cell(path)))
    alike = Counter((cell.rpartition("/")[0], size) for cell, size in sizes.items())
    found = []
    for path, array in arrays:
        cell = _cell(path)
        parent, slash, name = cell.rpartition("/")
        if cell and alike[parent, sizes[cell]] > 1:
            path = f"{parent}{slash}{path.rpartition('/')[2]}/{name}"
        found.append((path, array))
    return found


def _cell(path: str) -> str:
    """Return the path of the cell whose element an array is; empty if it is none."""
    cell, _, element = path.rpartition("/")
    return cell if element.isdigit() and not cell.rpartition("/")[2].isdigit() else ""


def _channels(arrays: Iterable[tuple[str, np.ndarray]]) -> list[Channel]:
    """Return the channels of named arrays; those of fewer than two samples are left out."""
    found = []
    for name, array in arrays:
        values = np.squeeze(np.asarray(array, dtype=float))
        if values.ndim == 1 and len(values) >= 2:
            found.append(Channel(name=name, values=values))
        elif values.ndim == 2 and min(values.shape) <= MAX_SIGNALS:
            table = values if values.shape[0] >= values.shape[1] else values.T
            found += [
                Channel(name=f"{name}/[{number}]", values=table[:, number])
                for number in range(table.shape[1])
            ]
    return found
