"""Evaluate one point of a model: what a worker does with an instance."""

import hashlib
import time
from collections.abc import Callable, Collection, Mapping
from importlib import metadata
from math import sin
from pathlib import Path
from platform import machine, python_version
from platform import system as operating_system

from models.description import complete
from models.evaluation import Evaluation
from sim.models import ASSESSMENTS, ISHIGAMI, MODELS, SOBOL_G

#: Coefficients of Sobol's g-function (Saltelli and Sobol 1995): the larger, the less influential.
G_COEFFICIENTS = (0.0, 1.0, 4.5, 9.0, 99.0, 99.0)


def evaluate(
    model: str, parameters: Mapping[str, float], curves: Collection[str] = ()
) -> Evaluation:
    """Evaluate `model` at `parameters` (SI units; a factor left out takes its nominal value).

    `curves`: the optional outputs that are wanted, too.

    Raises:
        ValueError: the model, a parameter or a curve of it is unknown, or a value is not finite.
    """
    if model not in MODELS:
        raise ValueError(f"unknown model {model!r}: expected one of {', '.join(MODELS)}")
    values = complete(MODELS[model], parameters)
    started = time.perf_counter()
    if model in ASSESSMENTS:
        from sim.assessment.assess import assess

        setup = ASSESSMENTS[model]
        assessment = assess(values, curves=curves, **setup.setting)
        outputs = dict(assessment.outputs)
        if setup.records and outputs and assessment.record is not None:
            from sim.assessment.summary import summary_of
            from sim.parameters.conditions import split

            outputs |= summary_of(assessment.record, split(values)[1])
        return Evaluation(
            outcome=assessment.outcome,
            outputs=outputs,
            reason=assessment.reason,
            state=assessment.state,
            wall_seconds=time.perf_counter() - started,
        )
    y = _CLOSED_FORMS[model](tuple(values.values()))
    return Evaluation(outcome="ok", outputs={"y": y}, wall_seconds=time.perf_counter() - started)


def load(model: str) -> None:
    """Import what evaluates `model`, which takes longer than many an evaluation."""
    if model in ASSESSMENTS:
        import sim.assessment.assess
        import sim.assessment.summary  # noqa: F401


def versions() -> dict[str, str]:
    """Return what decides whether two machines compute the same bits."""
    return {
        "rehyb": metadata.version("rehyb"),
        "mujoco": metadata.version("mujoco-core"),
        "numpy": metadata.version("numpy"),
        "python": python_version(),
        "platform": f"{operating_system()}-{machine()}",
    }


def code() -> str:
    """Return a digest of the sources of `sim`: it shows a changed model where no version does."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted((*folder.rglob("*.py"), *folder.rglob("*.xml"))):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def identity() -> dict[str, str]:
    """Return what is equal on all machines that work on one study."""
    return {"code": code(), "mujoco": versions()["mujoco"]}


def _ishigami(x: tuple[float, ...]) -> float:
    """Ishigami and Homma 1990, with a = 7 and b = 0.1."""
    return sin(x[0]) + 7.0 * sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * sin(x[0])


def _sobol_g(x: tuple[float, ...]) -> float:
    """Saltelli and Sobol 1995: the product of (|4 x_i - 2| + a_i) / (1 + a_i)."""
    y = 1.0
    for x_i, a_i in zip(x, G_COEFFICIENTS, strict=True):
        y *= (abs(4.0 * x_i - 2.0) + a_i) / (1.0 + a_i)
    return y


_CLOSED_FORMS: Mapping[str, Callable[[tuple[float, ...]], float]] = {
    ISHIGAMI.name: _ishigami,
    SOBOL_G.name: _sobol_g,
}
