"""The face of rehyb: a client for scripts, and the `rehyb` command."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from models.evaluation import ModelFailure
    from rehyb.client import Client
    from rehyb.errors import (
        CampaignError,
        Conflict,
        FleetError,
        Invalid,
        NotFound,
        RehybError,
        ServerError,
        Unauthorized,
        Unreachable,
    )

__all__ = [
    "CampaignError",
    "Client",
    "Conflict",
    "FleetError",
    "Invalid",
    "ModelFailure",
    "NotFound",
    "RehybError",
    "ServerError",
    "Unauthorized",
    "Unreachable",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Load what scripts use when they ask for it.

        `python -m rehyb` loads this file first, when it has yet to say where ours is looked for.
        """
        if name not in __all__:
            raise AttributeError(f"module 'rehyb' has no attribute {name!r}")
        home = {"Client": "rehyb.client", "ModelFailure": "models.evaluation"}
        return getattr(import_module(home.get(name, "rehyb.errors")), name)
