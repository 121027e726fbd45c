"""What a request's body may have, for who wrote a key wrongly."""

from collections.abc import Sequence
from typing import Any, get_args, get_origin, get_type_hints

from pydantic import BaseModel


def body_of_route(route: Any) -> Any:
    """Return the type of the body that a route takes; None if it takes none, or is none."""
    endpoint = getattr(route, "endpoint", None)
    return None if endpoint is None else get_type_hints(endpoint).get("body")


def known_keys(kind: Any, place: Sequence[str | int]) -> list[str]:
    """Return which keys an object at a place within a body of a type may have; none: any, or none.

    Args:
        kind: a model, or a list, dict or union with one in it.
        place: keys and numbers, from outside in.
    """
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if not place:
            return [*kind.model_fields]
        field = kind.model_fields.get(str(place[0]))
        return [] if field is None else known_keys(field.annotation, place[1:])
    inside = place[1:] if get_origin(kind) in (list, dict) else place
    return next((found for part in get_args(kind) if (found := known_keys(part, inside))), [])
