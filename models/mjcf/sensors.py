"""Outputs of an `mjcf` model: sensors over time, reduced to one number or to a curve."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from intake.xml import listed
from models.evaluation import ModelFailure
from models.folder import ModelError, ModelFolder

Array = np.ndarray[Any, np.dtype[np.float64]]

#: Of times (s) and values; an integral is over time.
REDUCTIONS: Mapping[str, Callable[[Array, Array], Any]] = {
    "first": lambda t, x: x[0],
    "last": lambda t, x: x[-1],
    "min": lambda t, x: x.min(),
    "max": lambda t, x: x.max(),
    "mean": lambda t, x: x.mean(),
    "rms": lambda t, x: np.sqrt(np.mean(x**2)),
    "peak": lambda t, x: np.abs(x).max(),
    "range": lambda t, x: np.ptp(x),
    "integral": lambda t, x: np.trapezoid(x, t),
}
_SENSOR = re.compile(r"(?P<name>.+?)(\[(?P<index>\d{1,6})\])?")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How one output is read."""

    output: str
    #: Column of MuJoCo's `sensordata`.
    column: int
    reduce: str | None
    curve: int | None
    #: Column of the sensor over which the curve runs; None: time.
    over: int | None

    def of(self, times: Array, sensors: Array) -> float | Array:
        """Return the output.

        Args:
            times: s, one for each row.
            sensors: MuJoCo's `sensordata` at these times.

        Raises:
            ModelFailure: "axis_not_growing": the sensor over which a curve runs turns back.
        """
        values = sensors[:, self.column]
        if self.curve is None:
            assert self.reduce is not None
            return float(REDUCTIONS[self.reduce](times, values))
        axis = times if self.over is None else sensors[:, self.over]
        if not np.all(np.diff(axis) > 0):
            raise ModelFailure(
                "axis_not_growing", f"the sensor over which {self.output} runs does not only grow"
            )
        return np.interp(np.linspace(axis[0], axis[-1], self.curve), axis, values)


def readings(folder: ModelFolder, model: mujoco.MjModel) -> tuple[Reading, ...]:
    """Return how the outputs of a model are read.

    Raises:
        ModelError: an output names no sensor of the model, or says neither or both of `reduce` and
            `curve`.
    """
    found = []
    for i, output in enumerate(folder.description.results):
        where, said = f"outputs[{i}]", folder.mjcf[output.name]
        if "sensor" not in said:
            raise ModelError(f"{where}.sensor is missing: name a sensor of the file")
        reduce, over = said.get("reduce"), said.get("over")
        if (reduce is None) == (output.curve is None):
            raise ModelError(f"{where}: say either `reduce` or `curve`")
        if reduce is not None and reduce not in REDUCTIONS:
            raise ModelError(f"{where}.reduce must be one of {', '.join(REDUCTIONS)}")
        if over is not None and output.curve is None:
            raise ModelError(f"{where}.over is for a curve only")
        found.append(
            Reading(
                output=output.name,
                column=_column(model, said["sensor"], f"{where}.sensor"),
                reduce=reduce,
                curve=output.curve,
                over=None if over in (None, "time") else _column(model, over, f"{where}.over"),
            )
        )
    return tuple(found)


def _column(model: mujoco.MjModel, said: Any, where: str) -> int:
    match = _SENSOR.fullmatch(said) if isinstance(said, str) else None
    number = -1
    if match is not None:
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, match["name"])
    if match is None or number < 0:
        there = listed(model.sensor(i).name for i in range(model.nsensor))
        raise ModelError(f"{where}: there is no sensor {str(said)[:60]!r}; the file has {there}")
    size, index = int(model.sensor_dim[number]), int(match["index"] or 0)
    if match["index"] is None and size > 1:
        raise ModelError(
            f"{where}: {said} has {size} entries: write {said}[0] to {said}[{size - 1}]"
        )
    if index >= size:
        raise ModelError(f"{where}: {match['name']} has the entries 0 to {size - 1}")
    return int(model.sensor_adr[number]) + index
