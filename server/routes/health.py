"""Is the coordinator alive, and can it work? Open to whoever supervises it."""

from fastapi import APIRouter, HTTPException, Request

from server.http.problems import AGAIN
from server.routes.common import Route

router = APIRouter(tags=["health"], route_class=Route)


@router.get("/healthz")
def alive() -> dict[str, str]:
    """Answer as long as the process runs."""
    return {"status": "ok"}


@router.get("/readyz")
async def ready(request: Request) -> dict[str, str]:
    """Answer 200 if a worker could be served, else 503: the schema is another, the disk is full."""
    objection = await request.app.state.readiness.objection()
    if objection is not None:
        raise HTTPException(503, f"the database cannot be used: {objection}", headers=AGAIN)
    return {"status": "ready"}
