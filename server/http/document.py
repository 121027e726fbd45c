"""What the OpenAPI document says of refusals: once, and of every operation."""

from typing import Any

from fastapi import FastAPI

_PLACES = (
    "A JSON pointer (RFC 6901) into the body; /query/NAME, /path/NAME or /header/NAME of what came "
    "there."
)
_POINTER = {"type": "string", "description": _PLACES}
#: A problem's body: see `server.http.problems`.
PROBLEM: dict[str, Any] = {
    "title": "Problem",
    "description": "Why a request was refused, or why the coordinator failed at it (RFC 9457).",
    "type": "object",
    "properties": {
        "type": {"type": "string", "const": "about:blank"},
        "title": {"type": "string", "description": "What the status says."},
        "status": {"type": "integer"},
        "detail": {"type": "string", "description": "What is wrong and what would be right."},
        "pointer": {**_POINTER, "description": f"Where the one fault is. {_PLACES}"},
        "errors": {
            "type": "array",
            "description": "Several faults; of one, detail and pointer tell.",
            "minItems": 2,
            "items": {
                "type": "object",
                "properties": {"pointer": _POINTER, "detail": {"type": "string"}},
                "required": ["pointer", "detail"],
            },
        },
        "file": {"type": "string", "description": "Of what was uploaded, the file at fault."},
        "column": {"type": ["string", "null"]},
        "line": {"type": ["integer", "null"], "description": "The header is line 1."},
    },
    "required": ["type", "title", "status", "detail"],
}
_REFUSAL = {
    "description": "A problem, whatever the status.",
    "content": {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
_PROBLEM = {"$ref": "#/components/responses/Problem"}
#: What FastAPI would answer to a request that it cannot read.
_FASTAPIS = ("HTTPValidationError", "ValidationError")


class Described(FastAPI):
    """An application whose document says of every operation that it refuses with a problem."""

    def openapi(self) -> dict[str, Any]:
        """Return the OpenAPI document."""
        document = super().openapi()
        for methods in document["paths"].values():
            for operation in methods.values():
                answers = operation["responses"]
                answers.pop("422", None)
                answers |= dict.fromkeys(("4XX", "5XX"), _PROBLEM)
        parts = document["components"]
        for name in _FASTAPIS:
            parts["schemas"].pop(name, None)
        parts["schemas"]["Problem"] = PROBLEM
        parts["responses"] = {"Problem": _REFUSAL}
        return document
