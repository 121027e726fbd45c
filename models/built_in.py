"""The models that come with rehyb, found by name: nothing that reads descriptions imports them."""

from collections.abc import Collection, Mapping
from importlib import import_module

from models.description import Description
from models.evaluation import Evaluation

#: Where they are described: a mapping `MODELS` by name; and what has `evaluate`.
MODULE, EVALUATION = "sim.models", "sim.evaluation"


def built_in_models() -> Mapping[str, Description]:
    """Return the descriptions of models that come with rehyb, by name."""
    found: Mapping[str, Description] = import_module(MODULE).MODELS
    return found


def load_built_in(model: str) -> None:
    """Load what evaluates a model that comes with rehyb, MuJoCo if it needs that."""
    import_module(EVALUATION).load(model)


def evaluate_built_in(
    model: str, parameters: Mapping[str, float], curves: Collection[str] = ()
) -> Evaluation:
    """Evaluate a model that comes with rehyb."""
    found: Evaluation = import_module(EVALUATION).evaluate(model, parameters, curves)
    return found
