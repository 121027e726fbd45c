"""The face of rehyb: a client for scripts, and the `rehyb` command."""

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
