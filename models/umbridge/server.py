"""Serve models to everybody who samples with an UM-Bridge client."""

import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from models.description import Description, complete
from models.evaluation import Evaluation
from models.umbridge.client import PROTOCOL

#: A request is one vector for one model.
MAX_BODY_BYTES = 5_000_000
#: Seconds until a client that stops in the middle of a request is left.
READ_SECONDS = 30.0
_UNSUPPORTED = ("Gradient", "ApplyJacobian", "ApplyHessian")

Evaluate = Callable[[str, Mapping[str, float]], Evaluation]


class _RefusedError(Exception):
    """An answer that says what was wrong."""

    def __init__(self, kind: str, message: str, status: int = HTTPStatus.BAD_REQUEST) -> None:
        super().__init__(message)
        self.status = status
        self.body = {"error": {"type": kind, "message": message}}


def serve(
    descriptions: Mapping[str, Description], evaluate: Evaluate, host: str, port: int
) -> ThreadingHTTPServer:
    """Return a server of models that is bound and not yet running.

    Args:
        descriptions: by the names under which they are served.
        evaluate: of a name and parameters (SI units); called from several threads.
        host: address to listen on.
        port: 0: any that is free.

    Raises:
        OSError: the address is taken or not ours.
    """

    answering = partial(answer, descriptions, evaluate)
    return ThreadingHTTPServer((host, port), partial(_Handler, answering))


def answer(
    descriptions: Mapping[str, Description],
    evaluate: Evaluate,
    path: str,
    asked: Mapping[str, Any],
) -> Mapping[str, Any]:
    """Return the body of the answer to one request.

    Raises:
        _RefusedError: UM-Bridge's own error for what was asked.
    """
    if path == "Info":
        return {"protocolVersion": PROTOCOL, "models": list(descriptions)}
    name = asked.get("name")
    if name not in descriptions and not (path in _UNSUPPORTED and name is None):
        raise _RefusedError("ModelNotFound", f"there is no model {str(name)[:80]!r} here")
    if path in _UNSUPPORTED:
        raise _RefusedError("UnsupportedFeature", f"{path} is not supported by {name}")
    description = descriptions[str(name)]
    factors = [factor.name for factor in description.factors]
    if path == "InputSizes":
        return {"inputSizes": [len(factors)]}
    if path == "OutputSizes":
        return {"outputSizes": [len(description.outputs)]}
    if path == "ModelInfo":
        return {"support": {"Evaluate": True} | dict.fromkeys(_UNSUPPORTED, False)}
    if path != "Evaluate":
        raise _RefusedError("UnsupportedFeature", f"/{path} is unknown", HTTPStatus.NOT_FOUND)
    vectors = asked.get("input")
    if not (
        isinstance(vectors, list)
        and len(vectors) == 1
        and isinstance(vectors[0], list)
        and len(vectors[0]) == len(factors)
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in vectors[0])
    ):
        raise _RefusedError(
            "InvalidInput", f"input must be one vector of {len(factors)}: {', '.join(factors)}"
        )
    try:
        asked_for = dict(zip(factors, map(float, vectors[0]), strict=True))
        done = evaluate(str(name), complete(description, asked_for))
    except (OverflowError, ValueError) as error:
        raise _RefusedError("InvalidInput", str(error)) from None
    if done.outcome != "ok":
        raise _RefusedError(
            "ModelFailure", f"{done.outcome}: {done.reason}", HTTPStatus.INTERNAL_SERVER_ERROR
        )
    return {"output": [[done.outputs[column] for column in description.outputs]]}


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = READ_SECONDS

    def __init__(
        self, answering: Callable[[str, Mapping[str, Any]], Mapping[str, Any]], *of_server: Any
    ) -> None:
        self._answering = answering
        # It serves the connection at once.
        super().__init__(*of_server)

    def do_GET(self) -> None:
        self._handle({})

    def do_HEAD(self) -> None:
        self._send(HTTPStatus.OK, {})

    def do_POST(self) -> None:
        try:
            asked = self._body()
        except _RefusedError as refused:
            # What is left of the body is not the next request.
            self.close_connection = True
            self._send(refused.status, refused.body)
            return
        self._handle(asked)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: an evaluation takes less than a line on the terminal."""

    def _body(self) -> Mapping[str, Any]:
        length = self.headers.get("Content-Length", "")
        # Python reads no number of thousands of digits.
        if not re.fullmatch("[0-9]{1,12}", length) or int(length) > MAX_BODY_BYTES:
            raise _RefusedError(
                "InvalidInput", f"the body must have at most {MAX_BODY_BYTES} bytes"
            )
        try:
            asked = json.loads(self.rfile.read(int(length)) or b"{}")
        except (ValueError, RecursionError):
            raise _RefusedError("InvalidInput", "the body is not JSON") from None
        if not isinstance(asked, dict):
            raise _RefusedError("InvalidInput", "the body must be an object")
        return asked

    def _handle(self, asked: Mapping[str, Any]) -> None:
        try:
            self._send(HTTPStatus.OK, self._answering(self.path.strip("/"), asked))
        except _RefusedError as refused:
            self._send(refused.status, refused.body)

    def _send(self, status: int, body: Mapping[str, Any]) -> None:
        content = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)
