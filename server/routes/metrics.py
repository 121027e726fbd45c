"""Metrics for a Prometheus server, which needs a token with the scope `read`."""

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from server.routes.common import Measures, Route

router = APIRouter(tags=["health"], route_class=Route)


@router.get("/metrics", response_class=Response)
def metrics(measures: Measures) -> Response:
    """Return the metrics in Prometheus's text format."""
    return Response(generate_latest(measures.registry), media_type=CONTENT_TYPE_LATEST)
