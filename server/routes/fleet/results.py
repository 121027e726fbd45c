"""Results: workers post them, readers download them."""

import asyncio
import csv
import io
import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from http import HTTPStatus
from importlib.util import find_spec
from itertools import chain, islice
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, HTTPException, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import ConfigDict, Field, StringConstraints
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import State

from analysis.files.parquet import parquet
from analysis.files.results_csv import columns
from server.logic.fleet.verdicts import Judgement, Report
from server.logic.json_values import is_unicode
from server.logic.study.table import lines
from server.metrics import Metrics
from server.operations.fleet import results
from server.operations.fleet.exchange import Answer, Exchange, Grant, Ineligible, Post
from server.operations.study import studies
from server.routes.common import Body, Direct, Id, Name, Route, Store, as_json, example
from server.routes.fleet.leases import LEASE, Fence, LeaseBody, granted, requested, sweep
from server.routes.study.studies import show
from server.settings import Settings
from server.states import REFUSALS, Verdict
from server.store.database.presence import why_away

if TYPE_CHECKING:
    from server.tracing import Traces

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1", tags=["results"], route_class=Route)

Short = Annotated[str, StringConstraints(max_length=256)]

#: What `/readyz` calls what a worker was not given.
POST = "post of results"
#: Lines sent at a time.
CHUNK = 500


class ResultBody(Body):
    """One result; its values are judged one result at a time, so that one cannot spoil all."""

    # A key that nobody knows is a fault of that result alone, too.
    model_config = ConfigDict(extra="allow", json_schema_extra={"additionalProperties": False})

    instance: Short
    #: "ok", or a name of a failure.
    outcome: Any
    #: Numbers by name, of curves lists; of a failure they are ignored.
    outputs: Any = None
    #: A sentence or a traceback.
    reason: Any = None
    #: An object, the state in which it failed.
    state: Any = None
    wall_seconds: Any = None


class ResultsBody(Body):
    """Results of one lease."""

    model_config = example(
        lease="0f8e4ab7c5d94e2b8a1d6c3f7e9b2a10",
        fence=17,
        worker="pc7-4711",
        results=[
            {
                "instance": "3fb1c2a4d5e6:0:3",
                "outcome": "slipped",
                "outputs": {},
                "reason": "the forearm left its cuff at 0.42 s",
                "state": {"time": 0.42},
                "wall_seconds": 0.31,
            }
        ],
        next={
            "worker": {"id": "pc7-4711", "host": "pc7", "versions": {"mujoco": "4.0.1"}},
            "models": ["ishigami"],
            "max_instances": 4,
        },
    )

    lease: Name
    fence: Fence
    worker: Name
    results: list[ResultBody] = Field(min_length=1, max_length=1000)
    #: Instances wanted next, as at /v1/leases: the answer brings them along.
    next: LeaseBody | None = None

    @classmethod
    def mended(cls, content: Any) -> Any:
        """Write keys and instances of results so that they are text, though none that is known."""
        if not isinstance(content, dict) or not isinstance(content.get("results"), list):
            return content
        return {**content, "results": [_mended(one) for one in content["results"]]}


def _mended(result: Any) -> Any:
    if not isinstance(result, dict):
        return result
    whole = {key if is_unicode(key) else ascii(key): value for key, value in result.items()}
    name = whole.get("instance")
    if isinstance(name, str) and not is_unicode(name):
        whole["instance"] = ascii(name)
    return whole


async def post(body: ResultsBody, request: Request) -> Response:
    """Take in results; 409 if any was refused, and its verdict says why.

    With `next`, lease further instances in the same breath: `next` of the answer is the lease, null
    if there is nothing to do now, and `misfit` says why if there is nothing that the worker fits.
    """
    state = request.app.state
    settings, measures = state.settings, state.metrics
    now, ttl = state.clock(), settings.lease_seconds
    posted = _posted(body, settings)
    answer: dict[str, Any] = {}
    headers: dict[str, str] = {}
    if body.next is None:
        judgements, _ = await _exchanged(state, Exchange(posted=posted, now=now, ttl=ttl))
    else:
        asked = requested(body.next)
        both = Exchange(posted=posted, request=asked, now=now, ttl=ttl)
        judgements, found = await _exchanged(state, both)
        misfit = found.why if isinstance(found, Ineligible) else None
        measures.misfits.inc(misfit is not None)
        answer["misfit"] = misfit
        answer["next"] = granted(found, state) if isinstance(found, Grant) else None
        if answer["next"] is None:
            headers["Retry-After"] = str(state.idle.tell(body.next.worker.id, now))
        else:
            state.idle.busy(body.next.worker.id)
    # Once it is answered, and others whose turn it was: they wait, and those who count do not.
    asyncio.get_running_loop().call_soon(_note, body, judgements, measures, state.traces)
    answer["verdicts"] = [
        # As plain text, which is worded in a tenth of the time that an enum takes.
        {"instance": j.about, "verdict": str(j.verdict), "detail": j.detail}
        for j in judgements
    ]
    refused = any(judgement.verdict in REFUSALS for judgement in judgements)
    return as_json(answer, HTTPStatus.CONFLICT if refused else HTTPStatus.OK, headers)


router.add_api_route(
    "/results",
    post,
    methods=["POST"],
    response_model=dict[str, Any],
    responses={
        409: {
            "description": "The same, with a refusal among the verdicts.",
            "content": {"application/json": {"schema": {"type": "object"}}},
        }
    },
    route_class_override=Direct,
)


async def _exchanged(state: State, exchange: Exchange) -> Answer:
    """Serve a worker that posts, and note how that went for `/readyz`."""
    answer: Answer
    try:
        if exchange.request is None:
            answer = await state.exchange(exchange)
        else:
            await sweep(state)
            with state.metrics.lease_seconds.time():
                answer = await state.exchange(exchange)
    except SQLAlchemyError as error:
        # Not of what one body alone brings about: others would be served.
        if why_away(error) is not None:
            state.readiness.failed(POST, error)
        raise
    state.readiness.served(POST, *([] if exchange.request is None else [LEASE]))
    return answer


def _posted(body: ResultsBody, settings: Settings) -> Post:
    return Post(
        reports=[
            Report(**vars(result), unknown=next(iter(result.model_extra or ()), None))
            for result in body.results
        ],
        lease=body.lease,
        fence=body.fence,
        worker=body.worker,
        share=settings.recompute_share,
        tolerance=settings.recompute_tolerance,
    )


def _note(
    body: ResultsBody, judgements: Sequence[Judgement], measures: Metrics, traces: "Traces | None"
) -> None:
    """Count what came, log what was refused, and trace what was accepted."""
    for said, count in Counter(judgement.verdict for judgement in judgements).items():
        measures.verdicts.labels(said).inc(count)
    accepted = Verdict.ACCEPTED
    for result, judgement in zip(body.results, judgements, strict=True):
        if judgement.verdict == accepted:
            if result.wall_seconds is not None:
                measures.run_seconds.observe(result.wall_seconds)
        elif judgement.verdict in REFUSALS:
            why = judgement.verdict, judgement.detail
            about = {"instance": judgement.about, "lease": body.lease, "worker": body.worker}
            log.info("result refused as %s: %s", *why, extra=about)
    if traces is not None:
        _trace(body, judgements, traces)


def _trace(body: ResultsBody, judgements: Sequence[Judgement], traces: "Traces") -> None:
    """Tell of what was accepted; only of that is certain what it belongs to."""
    taken = [one.about for one in judgements if one.verdict == Verdict.ACCEPTED]
    if taken:
        study = taken[0].partition(":")[0]
        traces.completed(study, body.lease, body.worker, len(taken))


@router.get("/studies/{study_id}/results.csv")
def table(study_id: Id, store: Store) -> StreamingResponse:
    """Stream the results so far, by row and position, with the factor values they belong to."""
    study = studies.get(store, study_id)
    rows = lines(study.plan, results.in_order(store, study))
    return StreamingResponse(
        csv_text(chain([columns(study.plan.distributions, study.plan.outputs)], rows)),
        media_type="text/csv; charset=utf-8",
        headers={"Content-Disposition": f'attachment; filename="{study.id}.csv"'},
    )


@router.get("/studies/{study_id}/results.parquet")
def parquet_table(study_id: Id, store: Store) -> StreamingResponse:
    """Stream the same as Apache Parquet, the study's description and the units in its metadata."""
    if find_spec("pyarrow") is None:
        raise HTTPException(501, "Parquet needs pyarrow on the coordinator: install 'rehyb[files]'")
    study = studies.get(store, study_id)
    described = show(study_id, store)
    rows = lines(study.plan, results.in_order(store, study))
    return StreamingResponse(
        parquet(described, rows, described["units"]),
        media_type="application/vnd.apache.parquet",
        headers={"Content-Disposition": f'attachment; filename="{study.id}.parquet"'},
    )


def csv_text(rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """Yield rows as text, some at a time."""
    remaining = iter(rows)
    while chunk := list(islice(remaining, CHUNK)):
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(chunk)
        yield text.getvalue()
