"""Models: what can be studied, and of what each is made."""

from typing import Any

from server.operations import models
from server.web.page import Look, Page


def look(asked: Look) -> dict[str, Any]:
    """Return the newest version of every model."""
    return {"rows": models.every(asked.engine)}


def look_at_one(asked: Look) -> dict[str, Any]:
    """Return one model."""
    return {"model": models.get(asked.engine, asked.names["name"])}


PAGE = Page(path="/models", template="models.html", look=look)
ONE = Page(path="/models/{name}", template="model.html", look=look_at_one)
