"""The models that come with rehyb, found by name: nothing that reads descriptions imports them."""

from collections.abc import Collection, Mapping
from importlib import import_module

from models.description import Description
from models.evaluation import Evaluation

#: Where they are described: a mapping `MODELS` by name; and what has `evaluate`.
MODULE, EVALUATION = "sim.models", "sim.evaluation"


def own_models() -> Mapping[str, Description]:
    """Return the descriptions of rehyb's own models by name."""
    found: Mapping[str, Description] = import_module(MODULE).MODELS
    return found


def load_own(model: str) -> None:
    """Have what evaluates a model of rehyb's own in this process, MuJoCo if it needs that."""
    import_module(EVALUATION).load(model)


def evaluate_own(
    model: str, parameters: Mapping[str, float], curves: Collection[str] = ()
) -> Evaluation:
    """Evaluate a model of rehyb's own."""
    found: Evaluation = import_module(EVALUATION).evaluate(model, parameters, curves)
    return found
