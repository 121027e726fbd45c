"""What the routes share: where they find the store and the time, and how strictly they read."""

import time
from typing import Annotated, Any

from fastapi import Depends, Path, Request
from pydantic import BaseModel, ConfigDict, StringConstraints
from sqlalchemy.engine import Engine

from server.metrics import Metrics
from server.settings import Settings


class Body(BaseModel):
    """A request body: nothing unknown, nothing converted, no NaN and no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def example(**content: Any) -> ConfigDict:
    """Return a body's configuration with an example of it, which the documentation shows."""
    return ConfigDict(json_schema_extra={"examples": [content]})


def _engine(request: Request) -> Engine:
    engine: Engine = request.app.state.engine
    return engine


def _settings(request: Request) -> Settings:
    settings: Settings = request.app.state.settings
    return settings


def _metrics(request: Request) -> Metrics:
    metrics: Metrics = request.app.state.metrics
    return metrics


def clock() -> float:
    """Return the coordinator's time in seconds, UTC epoch. Tests put their own in its place."""
    return time.time()


Store = Annotated[Engine, Depends(_engine)]
Configured = Annotated[Settings, Depends(_settings)]
Measures = Annotated[Metrics, Depends(_metrics)]
Now = Annotated[float, Depends(clock)]

#: One line without control characters, which PostgreSQL and terminals would stumble over.
PRINTABLE = r"^[^\x00-\x1f\x7f]+$"

#: A name somebody gave to something: one line, no control characters.
Name = Annotated[str, StringConstraints(min_length=1, max_length=128, pattern=PRINTABLE)]
#: Identifiers in a path.
Id = Annotated[str, Path(max_length=128, pattern=PRINTABLE, examples=["3fb1c2a4d5e6"])]
LeaseId = Annotated[
    str, Path(max_length=128, pattern=PRINTABLE, examples=["0f8e4ab7c5d94e2b8a1d6c3f7e9b2a10"])
]
#: A whole number that a database can hold.
MAX_INTEGER = 2**63 - 1
