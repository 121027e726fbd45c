"""The coordinator as a web application."""

import asyncio
import logging
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING

from fastapi import FastAPI
from sqlalchemy.engine import Engine
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import State

from models.built_in import built_in_models
from server.clocks import Forward, steady
from server.errors import NotFoundError
from server.http import problems
from server.http.compression import Gunzip
from server.http.document import Described
from server.http.encodings import Utf8
from server.http.guards import MAX_BODY_BYTES, BodyLimit, Guard
from server.http.heads import Head
from server.logic.fleet.history import FleetHistory
from server.logic.fleet.idling import Idle
from server.logic.fleet.unserved import Patience
from server.metrics import Metrics
from server.operations import close_loops as close_loop_operations
from server.operations import models as model_operations
from server.operations import tokens
from server.operations.fleet import comparisons
from server.operations.fleet import leases as lease_operations
from server.operations.fleet.exchanges import Exchanges
from server.operations.fleet.sweep import Sweep
from server.operations.readiness import Readiness
from server.operations.study import reruns
from server.operations.study import studies as studies_at_work
from server.routes import (
    analyses,
    close_loop_leases,
    close_loops,
    health,
    metrics,
    models,
    sessions,
)
from server.routes.fleet import leases, results, workers
from server.routes.study import indices, instances, precision_goals, progress, studies
from server.sandbox import CHECKS
from server.settings import Settings
from server.store import create_engine, require_current
from server.store.database.engine import server_time
from server.store.database.presence import Presence
from server.threads import in_thread
from server.web import assets, fleet, pages, sign_in
from server.web.live import Hub

if TYPE_CHECKING:
    from server.tracing import Traces

log = logging.getLogger(__name__)

#: Variables of OpenTelemetry that say where traces go.
TRACES_TO = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")


#: The first that fits a request is taken, so what workers ask all the time comes first.
_NOUNS = (
    results,
    leases,
    studies,
    precision_goals,
    progress,
    indices,
    analyses,
    instances,
    workers,
    close_loop_leases,
    sessions,
    models,
    close_loops,
    metrics,
    health,
    sign_in,
    assets,
    pages,
)
#: What `/readyz` calls what workers ask for all the time, by path.
_OF_WORKERS = {"/v1/leases": leases.LEASE, "/v1/results": results.POST}


def create_app(settings: Settings) -> FastAPI:
    """Return the application; it opens the database when it starts, if `open_database` has not.

    Starting raises SchemaError unless `server.store.upgrade` has been run on the database.
    """
    traces = _traces()
    # The interactive documentation loads scripts from elsewhere; a lab may have no internet.
    app = Described(
        title="rehyb coordinator",
        version="1",
        docs_url=None,
        redoc_url=None,
        # It would send to whatever host the request names.
        redirect_slashes=False,
        lifespan=_lifespan,
        # `/metrics` is there; to ask whether anybody wants FastAPI's own costs every request.
        telemetry={
            "tracing": traces is not None,
            "tracer_provider": None if traces is None else traces.provider,
            "operation_spans": False,
            "metrics": False,
            "logs": False,
        },
    )
    app.state.traces = traces
    _share(app, settings)
    problems.install(app)
    for noun in _NOUNS:
        # As they are: to include them costs every request a second search.
        app.router.routes.extend(noun.router.routes)
    app.add_middleware(Utf8)
    app.add_middleware(Gunzip, limit=MAX_BODY_BYTES)
    app.add_middleware(BodyLimit, large=settings.session_bytes)
    app.add_middleware(
        Guard,
        token=settings.token.get_secret_value(),
        look_up=lambda secret_or_id: tokens.good(app.state.engine, secret_or_id),
        clock=lambda: float(app.state.clock()),
        believed=app.state.sign_in.believed,
        failed=partial(_note_failure, app.state),
    )
    app.add_middleware(Head)
    return app


def _note_failure(state: State, path: str, error: Exception) -> None:
    """Note for `/readyz` that a worker was not even let in."""
    if path in _OF_WORKERS:
        state.readiness.failed(_OF_WORKERS[path], error)


def _share(app: FastAPI, settings: Settings) -> None:
    """Make what requests and tasks of this coordinator share, `app.state`."""
    app.state.settings = settings
    app.state.engine = create_engine(
        settings.database_url, durability=settings.durability, presence=Presence()
    )
    app.state.exchange = Exchanges(app.state.engine)
    app.state.clock = app.state.own_clock = steady()
    app.state.readiness = Readiness(app.state.engine)
    app.state.metrics = Metrics(app.state.engine, lambda: float(app.state.clock()))
    app.state.sweep = Sweep(
        app.state.engine,
        lambda: float(app.state.clock()),
        settings.lease_seconds,
        follow=lambda moment: float(app.state.clock.follow(moment)),
    )
    #: Whether `open_database` is done.
    app.state.is_open = False
    app.state.idle = Idle()
    #: So many uploaded sessions are looked at at once.
    app.state.looks = asyncio.Semaphore(CHECKS)
    #: Set when the process is asked to stop: whoever streams must end.
    app.state.stopping = asyncio.Event()
    app.state.fleet_history = FleetHistory()
    app.state.hub = Hub(app.state.stopping)
    app.state.sign_in = sign_in.SignIn(settings.token.get_secret_value())


def open_database(state: State) -> None:
    """Do all that a coordinator needs its database for before it can serve; again if that failed.

    Raises:
        SchemaError: the database is not of this version.
    """
    require_current(state.engine)
    clock = state.clock
    if clock is state.own_clock:
        # Several coordinators agree by the one clock that all of them can see.
        clock = steady(partial(server_time, state.engine))
    # Set back while nobody served, it would give old leases as much longer.
    state.clock = Forward(clock)
    state.clock.follow(lease_operations.latest(state.engine))
    now = state.clock()
    state.patience = Patience(seconds=state.settings.stranded_seconds, since=now)
    model_operations.register_built_in(state.engine, built_in_models().values(), now=now)
    state.sweep.begin()
    studies_at_work.make_ready(state.engine)
    state.is_open = True


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Open the database and work unasked until the process is stopped.

    Raises:
        SchemaError: the database is not of this version.
    """
    state = app.state
    try:
        if not state.is_open:
            await in_thread(open_database, state)
        reaper = asyncio.create_task(
            _reap_for_ever(state.sweep, state.engine, state.metrics, state.clock, state.settings)
        )
        watcher = asyncio.create_task(fleet.watch(state))
        try:
            yield
        finally:
            for task in (reaper, watcher):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
    finally:
        # Also of what refuses to start.
        await state.exchange.close()
        state.readiness.close()
        if state.traces is not None:
            await in_thread(state.traces.close)
        state.engine.dispose()


def _traces() -> "Traces | None":
    """Return what tells of studies; None unless the environment says where to."""
    if os.environ.get("OTEL_SDK_DISABLED", "").lower() == "true":
        return None
    told = {name: where for name in TRACES_TO if (where := os.environ.get(name))}
    if not told:
        return None
    for name, where in told.items():
        if not where.startswith(("http://", "https://")):
            log.warning(
                "%s must begin with http:// or https://: nothing is sent to %r", name, where
            )
            return None
    try:
        from server.tracing import Traces, provider
    except ImportError:
        log.warning("%s is set, but nothing is traced: install 'rehyb[telemetry]'", TRACES_TO[0])
        return None
    return Traces(provider())


async def _reap_for_ever(
    sweep: Sweep,
    engine: Engine,
    measures: Metrics,
    clock: Callable[[], float],
    settings: Settings,
) -> None:
    """Take back expired leases, and rows that wait for machines that are gone, unasked."""
    started, patience = monotonic(), settings.stranded_seconds
    while True:
        await asyncio.sleep(settings.lease_seconds / 4.0)
        freed = 0
        try:
            lost = await in_thread(sweep)
            silent = await in_thread(close_loop_operations.reap, engine, now=clock())
            if silent:
                log.warning("%d close-loops came back from workers that fell silent", silent)
            await in_thread(comparisons.give_up, engine, now=clock(), patience=patience)
            # Whoever has not listened for so long cannot say that nobody spoke.
            if monotonic() - started >= patience:
                freed = await in_thread(
                    reruns.free_stranded_rows, engine, now=clock(), patience=patience
                )
        except (SQLAlchemyError, NotFoundError):
            # The latter: a study was deleted between two looks at it.
            log.exception("expired leases could not be taken back; trying again")
            continue
        measures.lost.inc(lost)
        measures.freed.inc(freed)
        if freed:
            log.warning("%d rows begin anew: no machine of their kind was heard of", freed)
        if lost:
            log.warning("%d instances came back from workers that fell silent", lost)
