"""Measured sessions: what closing the loop found in each, K_h of the wearer, and the figures."""

from html.parser import HTMLParser
from typing import Any

from jinja2 import TemplateError
from markupsafe import Markup
from sqlalchemy.engine import Engine

from server.logic.close_loops import parsed
from server.operations import close_loops, sessions, watching
from server.records import CloseLoopJob
from server.states import CloseLoopState, JobKind
from server.web.assets import templates
from server.web.cache import Cache
from server.web.page import Look, Page

#: What was found in a session, of each kind of job.
TEMPLATES = {
    JobKind.CLOSE_LOOP: "close_loop_findings.html",
    JobKind.INTERPRETATION: "interpretation_findings.html",
}
#: Sessions that are shown, the latest first.
MOST_SHOWN = 200
#: Of jobs that are done, by id; a report may have megabytes.
FINDINGS: Cache[str] = Cache(8)
PICTURES: Cache[list[tuple[str, str]]] = Cache(8)


def look(asked: Look) -> dict[str, Any]:
    """Return the sessions, and the latest job of each."""
    jobs: dict[tuple[str, str], CloseLoopJob] = {
        (job.session_id, job.kind): job for job in watching.every_close_loop(asked.engine)
    }
    found = sessions.every(asked.engine)
    rows = [
        {
            "session": session,
            "job": jobs.get((session.id, JobKind.CLOSE_LOOP)),
            "interpretation": jobs.get((session.id, JobKind.INTERPRETATION)),
        }
        for session in reversed(found)
    ]
    return {
        "rows": rows[:MOST_SHOWN],
        "hidden": max(0, len(rows) - MOST_SHOWN),
        "able": close_loops.at_work(asked.engine, now=asked.now),
        "banks": close_loops.banks(asked.engine, now=asked.now),
    }


def look_at_one(asked: Look) -> dict[str, Any]:
    """Return one job and, once it is done, what was found."""
    job, able = close_loops.standing(asked.engine, asked.names["loop_id"], now=asked.now)
    findings, pictures = "", list[tuple[str, str]]()
    if job.state == CloseLoopState.DONE:
        findings = FINDINGS.of(job.id, lambda: _findings(asked.engine, job))
        pictures = PICTURES.of(job.id, lambda: _pictures(asked.engine, job))
    return {
        "job": job,
        "able": able,
        "session": sessions.get(asked.engine, job.session_id),
        "findings": findings,
        "pictures": pictures,
    }


PAGE = Page(path="/loops", template="loops.html", look=look)
ONE = Page(path="/loops/{loop_id}", template="loop.html", look=look_at_one)


def _findings(engine: Engine, job: CloseLoopJob) -> str:
    """Return report.json in HTML; "" if a worker of another version wrote it otherwise."""
    report = parsed(_read(engine, job, "report.json"))
    try:
        return Markup(templates().get_template(TEMPLATES[job.kind]).render(report=report))
    except (TemplateError, TypeError):
        return ""


def _pictures(engine: Engine, job: CloseLoopJob) -> list[tuple[str, str]]:
    """Return the figures of report.html, each as its description and an image."""
    images = _Images()
    images.feed(_read(engine, job, "report.html").decode("utf-8", "replace"))
    return images.found


def _read(engine: Engine, job: CloseLoopJob, file: str) -> bytes:
    size = close_loops.file_size(engine, job, file)
    return b"".join(close_loops.read_file(engine, job, file, size))


class _Images(HTMLParser):
    """Finds the images that a page holds in itself; nothing else of it is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note one image."""
        known = dict(attrs)
        source = known.get("src") or ""
        if tag == "img" and source.startswith("data:image/png;base64,"):
            self.found.append((known.get("alt") or "figure", source))
