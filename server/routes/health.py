"""Is the coordinator alive, and can it work? Open to whoever supervises it."""

from fastapi import APIRouter, HTTPException
from sqlalchemy.exc import SQLAlchemyError

from server.errors import SchemaError
from server.routes.common import Store
from server.store import require_current

router = APIRouter(tags=["health"])


@router.get("/healthz")
def alive() -> dict[str, str]:
    """Answer as long as the process runs."""
    return {"status": "ok"}


@router.get("/readyz")
def ready(store: Store) -> dict[str, str]:
    """Answer 200 if the database can be reached and has this version's schema, else 503."""
    try:
        require_current(store)
    except (SchemaError, SQLAlchemyError) as error:
        raise HTTPException(503, f"the database cannot be used: {error}") from error
    return {"status": "ready"}
