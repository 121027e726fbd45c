"""Who works for this coordinator."""

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter

from server.routes.common import Store
from server.store import workers

router = APIRouter(prefix="/v1/workers", tags=["workers"])


@router.get("")
def every(store: Store) -> dict[str, Any]:
    """List every worker that has ever asked for work, the latest heard from first."""
    return {"workers": [asdict(worker) for worker in workers.every(store)]}
