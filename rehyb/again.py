"""Compute instances of any model here once more, as a worker would."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rehyb.client import Json
from rehyb.errors import Invalid, RehybError

if TYPE_CHECKING:
    from models.evaluation import Evaluation

#: Seconds that one evaluation may take.
SECONDS = 600.0
#: Largest relative difference of an output at which a result is said to come out again: rounding,
#: summed over a simulation, and no more. (The coordinator's second opinions forgive a thousandth.)
TOLERANCE = 1e-6
#: Outputs smaller than this (SI units) are compared as if they were as large.
LEAST = 1e-3


@dataclass(frozen=True, kw_only=True)
class Code:
    """What the user of this machine named: the code of models that are not data."""

    folders: Sequence[Path] = ()
    packages: Sequence[str] = ()
    servers: Sequence[str] = ()


@contextmanager
def evaluating(
    fetch: Callable[[str, Path], None], code: Code
) -> Iterator[Callable[[Json], "Evaluation"]]:
    """Yield what evaluates {"model", "parameters", "model_seed"} in a process of its own.

    Args:
        fetch: writes the zip file of an uploaded model, "name@digest", to a path.
        code: where the others are.

    Raises:
        RehybError: something in `code` cannot be used; and, when it is called, that the model
            cannot be had.
    """
    from models.running.places import NoModelError, Places
    from models.running.queue import EvaluationQueue

    with tempfile.TemporaryDirectory(prefix="rehyb-models-") as cache:
        places = Places(fetch=fetch, cache=Path(cache))

        def evaluate(instance: Json) -> "Evaluation":
            ready = places.prepared(instance)
            return queue.evaluate(
                ready["model"], ready.get("place"), ready["parameters"], ready.get("seed", 0)
            )

        try:
            places.have(code.folders, code.packages, code.servers)
            with EvaluationQueue(1, SECONDS) as queue:
                yield evaluate
        except NoModelError as error:
            raise RehybError(str(error)) from None


def not_here(version: str, kind: str, code: Code) -> Invalid:
    """Return the error for a model whose code nobody named, or in another version."""
    option = {"python": "--allow NAME", "umbridge": "--models DIR --umbridge URL"}
    named = code.folders or code.packages
    return Invalid(
        f"{version} is code ({kind}), "
        + ("and what you named here is another version" if named else "which never travels")
        + f": name it with {option.get(kind, '--models DIR')}, in that version"
    )


def compared(stored: Json, again: "Evaluation") -> tuple[bool, str]:
    """Compare a stored result {"outcome", "outputs"} with what came out here.

    Returns:
        Whether they agree, and a sentence.
    """
    if stored["outcome"] != again.outcome:
        return False, f"the study has {stored['outcome']}, and here it is {again.outcome}"
    apart = _difference(stored["outputs"] or {}, again.outputs)
    if apart == 0.0:
        return True, "comes out here bit for bit"
    return apart <= TOLERANCE, f"comes out here within {apart:.1g} of its size"


def _difference(stored: Mapping[str, float], again: Mapping[str, float]) -> float:
    """Return the largest relative difference of an output."""
    return max(
        (
            abs(value - again[name]) / max(abs(value), abs(again[name]), LEAST)
            for name, value in stored.items()
            if value != again[name]
        ),
        default=0.0,
    )
