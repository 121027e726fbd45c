"""Evaluate an `mjcf` model: change it, compile it, let it run, reduce its sensors."""

import csv
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isfinite
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from intake.xml import listed
from models.description import complete
from models.evaluation import ModelFailure, columns
from models.folder import ModelError, ModelFolder
from models.mjcf.compiling import compiled
from models.mjcf.factors import changes
from models.mjcf.sensors import Array, readings
from models.mjcf.xml import inside, read_spec

# MuJoCo would write its warnings into a file in the current folder; `_run` tells of them.
mujoco.set_mju_user_warning(lambda message: None)

#: Steps of one simulation, and sensor readings of it: a minute, and 800 MB, of one core.
MAX_STEPS, MAX_READINGS = 10_000_000, 100_000_000
MAX_CSV_BYTES = 50_000_000
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_TABLE = {"file", "duration", "keyframe", "record_from", "controls", "collisions"}
#: MuJoCo's warnings that make a simulation worthless, as outcomes.
_WARNINGS = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "diverged",
    mujoco.mjtWarning.mjWARN_BADQVEL: "diverged",
    mujoco.mjtWarning.mjWARN_BADQACC: "diverged",
    mujoco.mjtWarning.mjWARN_BADCTRL: "diverged",
    mujoco.mjtWarning.mjWARN_CONTACTFULL: "contact_overflow",
    mujoco.mjtWarning.mjWARN_CNSTRFULL: "contact_overflow",
}


class Simulation:
    """A model that is read once and evaluated at many points.

    Raises:
        ModelError: the folder's file, factors, outputs or controls cannot be used.
    """

    def __init__(self, folder: ModelFolder) -> None:
        run = folder.run
        folder.check_run(_TABLE)
        if not isinstance(run.get("file"), str):
            raise ModelError("mjcf.file must name the MJCF or URDF file")
        self._description = folder.description
        self._duration = _seconds(run, "duration", None)
        self._record_from = _seconds(run, "record_from", 0.0)
        if not self._record_from < self._duration:
            raise ModelError("mjcf.record_from must lie before the end, which is mjcf.duration")
        collisions = run.get("collisions", True)
        if not isinstance(collisions, bool):
            raise ModelError("mjcf.collisions must be true or false")
        self._spec = read_spec(folder.path, run["file"], collisions=collisions)
        try:
            model = compiled(self._spec)
            self._changes = changes(folder, self._spec)
        except ModelError:
            raise
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"MuJoCo refuses it: {_line(error)}", file=run["file"]) from None
        self._readings = readings(folder, model)
        self._keyframe = _keyframe(model, run.get("keyframe"))
        self._controls = _controls(folder, model, run.get("controls", {}))
        steps = self._duration / model.opt.timestep
        taken = (
            f"mjcf.duration of {self._duration:g} s takes {steps:.3g} steps of "
            f"{model.opt.timestep:g} s"
        )
        if steps > MAX_STEPS:
            raise ModelError(f"{taken}; at most {MAX_STEPS}")
        if steps * model.nsensordata > MAX_READINGS:
            raise ModelError(
                f"{taken}, and its sensors give {model.nsensordata} numbers at each; at most "
                f"{MAX_READINGS} in all"
            )

    def __call__(self, parameters: Mapping[str, float], seed: int = 0) -> dict[str, float]:
        """Return the outputs at `parameters` (SI units; one left out is nominal).

        Raises:
            ValueError: a parameter is unknown or not finite.
            ModelFailure: "invalid_model": MuJoCo refuses the changed model; "diverged";
                "contact_overflow"; "axis_not_growing".
        """
        values = complete(self._description, parameters)
        for change in self._changes:
            change.apply(values[change.factor])
        try:
            model = compiled(self._spec)
        except (ValueError, RuntimeError) as error:
            raise ModelFailure("invalid_model", f"MuJoCo refuses it: {_line(error)}") from None
        times, sensors = self._run(model)
        return columns(
            self._description,
            {reading.output: reading.of(times, sensors) for reading in self._readings},
        )

    def check_factors(self) -> None:
        """Check that each factor changes the compiled model.

        Raises:
            ModelError: one does not: what it sets stands in the file in another form.
        """
        for factor in self._description.factors:
            contents = []
            for value in (factor.low, factor.high):
                for change in self._changes:
                    if change.factor == factor.name:
                        change.apply(value)
                try:
                    contents.append(_content(compiled(self._spec)))
                except (ValueError, RuntimeError):
                    # A corner that MuJoCo refuses is a failure of that point, not of the model.
                    contents.append(b"")
            if contents[0] == contents[1]:
                paths = ", ".join(c.path for c in self._changes if c.factor == factor.name)
                raise ModelError(
                    f"factor {factor.name} changes nothing: the file states {paths} in another "
                    "form (euler or fromto, not quat or pos; fullinertia), or it scales 0"
                )
            for change in self._changes:
                if change.factor == factor.name:
                    change.apply(factor.nominal)

    def _run(self, model: mujoco.MjModel) -> tuple[Array, Array]:
        """Return times (s) and `sensordata` from `record_from` on."""
        data = mujoco.MjData(model)
        if self._keyframe is not None:
            mujoco.mj_resetDataKeyframe(model, data, self._keyframe)
        # Sensors are read before a step: one more, and the last reading is of the end.
        steps = round(self._duration / model.opt.timestep) + 1
        if steps * max(1, model.nsensordata, model.nu) > MAX_READINGS:
            raise ModelFailure(
                "invalid_model", f"a step of {model.opt.timestep:g} s makes {steps:,} steps of it"
            )
        start = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, start, _STATE)
        times = data.time + model.opt.timestep * np.arange(steps)
        control = np.tile(data.ctrl, (steps, 1))
        for actuator, signal in self._controls.items():
            control[:, actuator] = signal(times)
        _, sensors = rollout.rollout(model, data, start[None], control[None])
        for warning, outcome in _WARNINGS.items():
            if data.warning[warning].number:
                text = mujoco.mju_warningText(warning, data.warning[warning].lastinfo)
                raise ModelFailure(outcome, text, {"time": float(data.time)})
        kept = times >= self._record_from - 0.5 * model.opt.timestep
        return times[kept], sensors[0, kept]


def _seconds(run: Mapping[str, Any], name: str, default: float | None) -> float:
    value = run.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ModelError(f"mjcf.{name} must be a finite number of seconds")
    if value < 0 or (value == 0 and default is None):
        raise ModelError(f"mjcf.{name} must be positive, not {value}")
    return float(value)


def _keyframe(model: mujoco.MjModel, name: Any) -> int | None:
    if name is None:
        return None
    names = [model.key(i).name for i in range(model.nkey)]
    if name not in names:
        raise ModelError(
            f"mjcf.keyframe: there is no keyframe {str(name)[:60]!r}; the file has {listed(names)}"
        )
    return names.index(name)


def _controls(
    folder: ModelFolder, model: mujoco.MjModel, said: Any
) -> dict[int, Callable[[Array], Array]]:
    """Return, for each actuator that is named, its control as a function of time (s)."""
    if not isinstance(said, dict):
        raise ModelError("mjcf.controls must be a table of actuators")
    names = [model.actuator(i).name for i in range(model.nu)]
    found: dict[int, Callable[[Array], Array]] = {}
    for name, value in said.items():
        where = f"mjcf.controls.{name[:80]}"
        if name not in names:
            raise ModelError(f"{where}: there is no such actuator; the file has {listed(names)}")
        found[names.index(name)] = _signal(folder, value, where)
    return found


def _signal(folder: ModelFolder, value: Any, where: str) -> Callable[[Array], Array]:
    if isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value):
        return lambda times: np.full(len(times), float(value))
    if not isinstance(value, dict) or set(value) != {"file", "column"}:
        raise ModelError(f'{where} must be a number, or {{file = "a.csv", column = "NAME"}}')
    stamps, signal = _csv(folder, str(value["file"]), str(value["column"]), where)
    return lambda times: np.interp(times, stamps, signal)


def _csv(folder: ModelFolder, name: str, column: str, where: str) -> tuple[Array, Array]:
    path = inside(folder.path, name, where)
    if path.stat().st_size > MAX_CSV_BYTES:
        raise ModelError(f"is larger than {MAX_CSV_BYTES // 1_000_000} MB", file=name)
    stamps, signal = list[float](), list[float]()
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file)
            for needed in ("time", column):
                if needed not in (rows.fieldnames or ()):
                    raise ModelError(f"has no column {needed!r}, which {where} needs", file=name)
            for row in rows:
                at = f"line {rows.line_num}, column"
                stamps.append(_number(row["time"], f"{at} time", name))
                signal.append(_number(row[column], f"{at} {column}", name))
                if len(stamps) > 1 and not stamps[-1] > stamps[-2]:
                    raise ModelError(
                        f"{at} time: must grow, and {stamps[-1]:g} follows {stamps[-2]:g}",
                        file=name,
                    )
    except (UnicodeDecodeError, csv.Error):
        raise ModelError("must be a CSV file of numbers with a header", file=name) from None
    if not stamps:
        raise ModelError("has no line of numbers under its header", file=name)
    return np.array(stamps), np.array(signal)


def _number(cell: str | None, where: str, file: str) -> float:
    """Return a cell of a CSV file; None: its line is too short."""
    with suppress(ValueError):
        if isfinite(value := float(cell or "")):
            return value
    raise ModelError(f"{where}: must be a finite number, not {(cell or '')[:40]!r}", file=file)


def _content(model: mujoco.MjModel) -> bytes:
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
