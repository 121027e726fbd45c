"""The face of rehyb: a client for scripts, and the `rehyb` command."""

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
    "NotFound",
    "RehybError",
    "ServerError",
    "Unauthorized",
    "Unreachable",
]
