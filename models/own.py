"""The models that come with rehyb, found by name: nothing that reads descriptions imports them."""

from collections.abc import Mapping
from importlib import import_module

from models.description import Description

#: Where they are described: a mapping `MODELS` by name.
MODULE = "sim.models"


def own_models() -> Mapping[str, Description]:
    """Return the descriptions of rehyb's own models by name."""
    found: Mapping[str, Description] = import_module(MODULE).MODELS
    return found
