"""Indices from tables that somebody else sampled, and from a study's own results."""

from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from pydantic import StringConstraints
from sqlalchemy.engine import Engine
from starlette.concurrency import run_in_threadpool

from analysis.files.results_csv import columns
from server.http.texts import HIDDEN
from server.logic.study.table import lines
from server.operations.fleet import results
from server.operations.study import studies
from server.routes.common import Configured, Id, Route, Store
from server.routes.fleet.results import csv_text
from server.routes.uploads import FORM, receive
from server.sandbox import check

router = APIRouter(prefix="/v1", tags=["analyses"], route_class=Route)

_FILE = {"schema": {"type": "string", "format": "binary", "examples": ["x1,x2,y\n0.1,0.2,0.3\n"]}}
_BODY = {
    "text/csv": _FILE,
    "application/vnd.apache.parquet": _FILE,
    "multipart/form-data": FORM,
}
#: A spreadsheet's name of a column may go on in the next line.
Column = Annotated[
    str,
    StringConstraints(
        min_length=1, max_length=200, pattern=r"^[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f]+$"
    ),
]
Outputs = Annotated[list[Column] | None, Query(max_length=1000, examples=[["y"]])]
Factors = Annotated[list[Column] | None, Query(max_length=1000, examples=[["x1", "x2"]])]
Called = Annotated[
    # A file's name has 255 bytes at most, and is neither . nor ..
    str,
    StringConstraints(min_length=1, max_length=60, pattern=rf"^[^{HIDDEN}/\\.][^{HIDDEN}/\\]*$"),
]


@router.post("/analyses", openapi_extra={"requestBody": {"required": True, "content": _BODY}})
async def analyse(
    request: Request,
    settings: Configured,
    output: Outputs = None,
    factor: Factors = None,
    name: Annotated[Called, Query(examples=["runs.csv"])] = "table",
) -> dict[str, Any]:
    """Return the indices of a CSV or Parquet file's columns; nothing of the file is kept.

    `output` may come several times; without `factor` every other column of numbers is one. What
    cannot be analysed is refused (422) with a sentence, column and line.
    """
    with TemporaryDirectory(prefix="rehyb-upload-") as scratch:
        # Sentences call a file by its name.
        file = Path(scratch) / name
        await receive(request, file, settings.session_bytes)
        return await _answer(request, file, output, factor)


@router.post("/studies/{study_id}/analyses")
async def analyse_study(
    request: Request, study_id: Id, store: Store, output: Outputs = None
) -> dict[str, Any]:
    """Return what a study's results so far tell besides its own indices: a sample as any other."""
    study = await run_in_threadpool(studies.get, store, study_id)
    with TemporaryDirectory(prefix="rehyb-upload-") as scratch:
        file = Path(scratch) / f"{study.id}.csv"
        await run_in_threadpool(_write, store, study_id, file)
        return await _answer(request, file, output, None)


async def _answer(
    request: Request, file: Path, output: list[str] | None, factor: list[str] | None
) -> dict[str, Any]:
    async with request.app.state.looks:
        return await check(
            "analysis.given.check", file, wanted={"outputs": output, "factors": factor}
        )


def _write(store: Engine, study_id: str, path: Path) -> None:
    """Write a study's results as `GET /v1/studies/{id}/results.csv` does."""
    study = studies.get(store, study_id)
    rows = lines(study.plan, results.in_order(store, study))
    table = chain([columns(study.plan.distributions, study.plan.outputs)], rows)
    with path.open("w", newline="") as file:
        file.writelines(csv_text(table))
