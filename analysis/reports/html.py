"""Pages of HTML: one file each, without a reference to anything outside it.

A page is a Jinja template of `templates/`. All extend `base.html`, which has the style, and are
made of the pieces in `macros.html`; every value in them is escaped, and what would not be seen in
it is written out. Pictures are images in the page
itself, so a page stays near 1 MB and prints well, and labs without a network can read it.
"""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from analysis.reports.wording import visible, with_interval, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(template: str, *, script: str = "", **content: Any) -> str:
    """Return a page.

    Args:
        template: its file in `templates/`.
        script: the file there that the page runs: its own policy lets a browser run that, and load
            nothing. Without one the page has no policy.
        content: what the template shows.
    """
    folder = files("analysis.reports") / "templates"
    code = (folder / script).read_text(encoding="utf-8") if script else ""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )
    return (
        environment()
        .get_template(template)
        .render(**content, script=Markup(code), policy=policy if script else "")
    )


def data_uri(figure: Figure, kind: Literal["svg", "png"], dpi: float | None = None) -> str:
    """Return a figure as an image in the page; the same figure gives the same bytes."""
    import matplotlib as mpl

    if dpi is not None:
        figure.set_dpi(dpi)
    settle(figure)
    buffer = io.BytesIO()
    undated = {"Date": None, "Creator": "rehyb"} if kind == "svg" else None
    with mpl.rc_context({"svg.hashsalt": "rehyb"}):
        figure.savefig(buffer, format=kind, dpi=dpi or "figure", metadata=undated)
    media = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{media};base64,{base64.b64encode(buffer.getvalue()).decode()}"


def settle(figure: Figure) -> None:
    """Give a figure's panels their places, for every file that is written of it.

    matplotlib would find them again for each file, and draw everything once more to do so.
    """
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def cell(value: object) -> str:
    """Return what a table shows of a value.

    An index is {"value", "low", "high"} and is shown with its interval; other numbers have four
    digits; what is missing is a dash.
    """
    if isinstance(value, Mapping):
        if value["value"] is None:
            return cell(None)
        number, interval = with_interval(value["value"], value["low"], value["high"])
        return Markup("{} <small>{}</small>").format(number, interval) if interval else number
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(map(cell, value))
    return "–" if value is None else str(value)


@cache
def environment(*packages: str) -> Environment:
    """Return the templates of these packages and, below them, our own pieces."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in (*packages, "analysis.reports")]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=lambda value: visible(value) if isinstance(value, str) else value,
    )
    environment.filters |= {"cell": cell, "words": words}
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment
