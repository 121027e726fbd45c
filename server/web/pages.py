"""The pages, each at its address, and at /live and its address what changes in it."""

from collections.abc import Awaitable, Callable

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, StreamingResponse
from starlette.concurrency import run_in_threadpool

from server.errors import NotFoundError
from server.logic.tokens import may
from server.web import fleet, loops, models, new_study, studies
from server.web.assets import page_headers, render
from server.web.page import Look, Page
from server.web.study import compare, failures, overview, runs

router = APIRouter(include_in_schema=False)

PAGES = (
    studies.PAGE,
    new_study.PAGE,
    overview.PAGE,
    failures.PAGE,
    runs.PAGE,
    compare.PAGE,
    fleet.PAGE,
    loops.PAGE,
    loops.ONE,
    models.PAGE,
    models.ONE,
)

_NO_BUFFER = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}


def _look(request: Request) -> Look:
    return Look(
        engine=request.app.state.engine,
        now=request.app.state.clock(),
        may_submit=may(request.scope["rehyb.scopes"], ("submit",)),
        names=dict(request.path_params),
        choices=dict(request.query_params),
        state=request.app.state,
    )


def _shown(page: Page) -> Callable[[Request], Awaitable[Response]]:
    async def show(request: Request) -> Response:
        query = f"?{request.url.query}" if request.url.query else ""
        try:
            stream = f"/live{request.url.path}{query}"
            html = await run_in_threadpool(page.html, _look(request), stream=stream)
        except NotFoundError as error:
            html = await run_in_threadpool(render, "missing.html", sentence=str(error))
            return HTMLResponse(html, 404, headers=page_headers())
        return HTMLResponse(html, headers=page_headers())

    return show


def _followed(page: Page) -> Callable[[Request], Awaitable[Response]]:
    async def follow(request: Request) -> Response:
        first = _look(request)

        def parts() -> dict[str, object]:
            return page.parts(_look(request))

        return StreamingResponse(
            request.app.state.hub.follow(page.key(first), parts),
            media_type="text/event-stream",
            headers=_NO_BUFFER,
        )

    return follow


router.routes.extend(overview.router.routes)
for _page in PAGES:
    router.add_api_route(_page.path, _shown(_page), response_model=None)
    router.add_api_route(f"/live{_page.path}", _followed(_page), response_model=None)
