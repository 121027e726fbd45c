"""Arrays as a log: a vector is one channel, a matrix one for each of its shorter side."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.logs.trials import join_trials

#: A matrix with more signals is no recording of joints.
MAX_SIGNALS = 200


def log_of(kind: str, arrays: Iterable[tuple[str, np.ndarray]]) -> Log:
    """Return the log of arrays by their paths, `run_1/elbow/q`, with trials joined."""
    log = Log(kind=kind, channels=_channels(arrays))
    join_trials(log)
    log.channels = [
        replace(channel, name=channel.name.replace("/[", "[").replace("/", "."))
        for channel in log.channels
    ]
    return log


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
