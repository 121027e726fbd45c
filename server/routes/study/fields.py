"""What the parts of a request about studies may be."""

from typing import Annotated, Any

from fastapi import Header, Query
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    StringConstraints,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

from analysis.json_values import is_finite_number
from server.http.texts import PRINTABLE
from server.logic.json_values import is_unicode
from server.routes.common import Name


def _is_seen(one: str) -> bool:
    return one.isprintable() and not one.isspace()


def _not_blank(text: Any) -> Any:
    if isinstance(text, str) and text and not any(map(_is_seen, text)):
        raise PydanticCustomError("blank", "a name needs a character that can be seen")
    return text


def _of_a_worker(tag: str) -> str:
    # What `rehyb-worker --tags` makes of a list: no worker could ever have another one.
    if "," in tag or tag != tag.strip():
        raise PydanticCustomError(
            "tag",
            "no worker can have the tag {tag}: it has no comma, and no blank at its ends; "
            'several are several texts, as ["lab-2", "fast"]',
            {"tag": repr(tag)},
        )
    return tag


def _each_once(tags: list[str]) -> list[str]:
    twice = sorted({tag for tag in tags if tags.count(tag) > 1})
    if twice:
        raise PydanticCustomError(
            "tag", "{tag} comes twice: leave out one", {"tag": repr(twice[0])}
        )
    return tags


Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Title = Annotated[
    str,
    StringConstraints(min_length=1, max_length=200, pattern=PRINTABLE),
    # Whoever sent nothing else hears what is needed, not what is too much.
    BeforeValidator(_not_blank),
]
Tag = Annotated[Name, AfterValidator(_of_a_worker)]
Tags = Annotated[list[Tag], Field(max_length=20), AfterValidator(_each_once)]
Priority = Annotated[int, Field(ge=-1000, le=1000)]
After = Annotated[
    str | None,
    Query(
        pattern=r"^\d{1,18}\.\d{1,18}:[0-9a-f]{1,32}$",
        description="`next` of the page before",
        examples=["1767225600.0:3fb1c2a4d5e6"],
    ),
]
Key = Annotated[
    str | None, Header(alias="Idempotency-Key", min_length=1, max_length=255, examples=["masses-1"])
]


def _number_or_name(value: Any) -> float | str:
    if isinstance(value, str):
        return value
    if not is_finite_number(value):
        raise PydanticCustomError("value", "must be a finite number, or the name of a choice")
    return float(value)


def _number_numbers_or_text(value: Any) -> float | str | list[float]:
    if isinstance(value, str) and is_unicode(value):
        return value
    numbers = value if isinstance(value, list) else [value]
    if not all(map(is_finite_number, numbers)):
        raise PydanticCustomError("value", "must be a finite number, a list of them, or a text")
    floats = [float(number) for number in numbers]
    return floats if isinstance(value, list) else floats[0]


#: A union of types would tell of two faults, in places that the request does not have.
Value = Annotated[
    Any,
    PlainValidator(_number_or_name),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]
#: As `Value`, of a distribution.
Entry = Annotated[
    Any,
    PlainValidator(_number_numbers_or_text),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {"type": "number"},
                {"type": "array", "items": {"type": "number"}},
            ]
        }
    ),
]
