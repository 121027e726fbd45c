"""What pages are made of: templates, styles, modules of JavaScript, and plotly's library."""

import gzip
import hashlib
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from fastapi import APIRouter, HTTPException, Request, Response
from jinja2 import Environment

from analysis.reports.html import environment
from server.web.words import FILTERS

router = APIRouter()

#: Nothing is loaded from elsewhere and no script runs but our files. plotly writes styles into the
#: page; there is no harm in a colour. Its pictures to be saved are blobs.
POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
PLOTLY = "plotly.min.js"
_TYPES = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}
_TYPES[".svg"] = "image/svg+xml"


def page_headers() -> dict[str, str]:
    """Return the headers of every page."""
    return {
        "Content-Security-Policy": POLICY,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


@cache
def templates() -> Environment:
    """Return the templates, with what all of them may name."""
    made = environment("server.web")
    made.filters |= FILTERS
    made.globals |= {"static": f"/static/{_digest()}", "version": version("rehyb")}
    return made


def render(template: str, **content: object) -> str:
    """Return a page."""
    return templates().get_template(template).render(**content)


@router.get("/static/{digest}/{name}", include_in_schema=False)
def static(digest: str, name: str, request: Request) -> Response:
    """Return a file, which a browser may keep for ever: a changed one has another address."""
    path = _files().get(name)
    if path is None:
        raise HTTPException(404, f"there is no file {name}")
    headers = {"X-Content-Type-Options": "nosniff", "Vary": "Accept-Encoding"}
    kept = "public, max-age=31536000, immutable" if digest == _digest() else "no-store"
    headers["Cache-Control"] = kept
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(_compressed(name), headers=headers, media_type=_TYPES[path.suffix])
    return Response(path.read_bytes(), headers=headers, media_type=_TYPES[path.suffix])


@cache
def _files() -> dict[str, Path]:
    own = [*Path(str(files("server.web") / "static")).iterdir()]
    own.append(Path(str(files("analysis.reports") / "templates" / "style.css")))
    # Found, not imported: its Python half is of no use here.
    spec = find_spec("plotly")
    assert spec is not None and spec.origin is not None
    own.append(Path(spec.origin).parent / "package_data" / PLOTLY)
    return {path.name: path for path in own if path.suffix in _TYPES}


@cache
def _digest() -> str:
    digest = hashlib.sha256()
    for name, path in sorted(_files().items()):
        digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def _compressed(name: str) -> bytes:
    return gzip.compress(_files()[name].read_bytes(), 6, mtime=0)
