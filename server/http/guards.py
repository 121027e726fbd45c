"""What stands before every route: who may speak, and how much they may say at once."""

import asyncio
import hmac
import re
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from time import monotonic
from urllib.parse import quote

from fastapi import HTTPException
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.http.problems import problem, unless_away
from server.logic.signing_in import OPERATOR, READING, Seal, comes_from_here
from server.logic.tokens import FAILURE_SECONDS, Believed, Failures, may, scopes_needed
from server.records import Token

#: How paths begin that anybody may ask for: they say nothing of what is stored.
_OPEN = ("/healthz", "/readyz", "/sign-in", "/sign-out", "/static/")
#: Largest request body taken.
MAX_BODY_BYTES = 8 * 1024 * 1024
#: What a form adds to the file in it.
ENVELOPE_BYTES = 10_000
#: Of a body that is too large, what is read and thrown away so that its sender hears why.
DRAINED_BYTES, DRAINED_SECONDS = 2_000_000_000, 60.0
#: Seconds a token is believed after it was looked up: a revoked one is good for as long at most.
BELIEVED_SECONDS = 5.0

#: Returns the good token with a secret (bytes) or an id (str); None if there is none.
LookUp = Callable[[bytes | str], Token | None]
#: Whoever asks: a token's id, and its scopes; no scopes: a stranger.
Asker = tuple[str, tuple[str, ...]]
_STRANGER: Asker = ("", ())
_OPERATOR: Asker = (OPERATOR, ("admin",))


class Guard:
    """Turn away who may not, before anything of the request is read.

    A request bears a token in its header, or the cookie of somebody who signed in. It goes on with
    `scope["rehyb.who"]` and `scope["rehyb.scopes"]`.

    Args:
        app: what is guarded: all but `_OPEN`.
        token: the operator's own, which may do everything.
        look_up: finds all others in the database.
        clock: seconds, UTC epoch.
        believed: where it remembers good tokens.
        failed: is told of a path that was asked for, and of the database's error that kept it from
            finding out who asks.
    """

    def __init__(
        self,
        app: ASGIApp,
        token: str,
        look_up: LookUp,
        clock: Callable[[], float],
        believed: Believed,
        failed: Callable[[str, Exception], object],
    ) -> None:
        self._app = app
        self._expected = token.encode()
        self._look_up = look_up
        self._clock = clock
        self._seal = Seal(token)
        self._failures = Failures()
        self._believed = believed
        self._failed = failed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http" or scope["path"].startswith(_OPEN):
            await self._app(scope, receive, send)
            return
        refusal: ASGIApp | None
        try:
            refusal = await self._objection(scope)
        except (DBAPIError, NoConnectionError) as error:
            # Here, in front of all routes, nobody else answers what is raised.
            refusal = unless_away(error)
            self._failed(scope["path"], error)
        await (refusal or self._app)(scope, receive, send)

    async def _objection(self, scope: Scope) -> ASGIApp | None:
        """Return the answer to a request that is turned away; None if it may pass."""
        headers = Headers(scope=scope)
        borne, signed_in = _borne_by(headers), None
        address = (scope.get("client") or ("",))[0]
        now = monotonic()
        asker: Asker | None = _STRANGER
        if borne is not None:
            asker = await self._bearer(borne, address, now)
        elif (signed_in := self._signed_in(headers)) is not None:
            asker = _OPERATOR if signed_in == OPERATOR else await self._known(signed_in, now)
        if asker is None:
            return problem(
                HTTPStatus.TOO_MANY_REQUESTS,
                "too many wrong tokens came from this address: correct the token and wait",
                headers={"Retry-After": str(int(FAILURE_SECONDS))},
            )
        who, scopes = asker
        if not scopes:
            if borne is not None:
                self._failures.count(address, now)
            return _sign_in_first(scope, headers, _REFUSED if borne else _NEEDED)
        _let_in(scope)
        if signed_in and scope["method"] not in READING and not comes_from_here(headers):
            return problem(
                HTTPStatus.FORBIDDEN, "only this coordinator's own pages may ask for this"
            )
        needed = scopes_needed(scope["method"], scope["path"])
        scope["rehyb.who"], scope["rehyb.scopes"] = who, scopes
        if may(scopes, needed):
            return None
        has, needs = ", ".join(scopes), " or ".join(needed)
        return problem(
            HTTPStatus.FORBIDDEN, f"this needs a token with the scope {needs}; yours has {has}"
        )

    async def _bearer(self, borne: bytes, address: str, now: float) -> Asker | None:
        """Return who bears a token; None if its address has failed too often to ask."""
        if hmac.compare_digest(borne, self._expected):
            return _OPERATOR
        # A token that was good before must not suffer from what others send from its address.
        if borne not in self._believed and self._failures.too_many(address, now):
            return None
        return await self._known(borne, now) if borne else _STRANGER

    async def _known(self, secret_or_id: bytes | str, now: float) -> Asker:
        until, asker = self._believed.get(secret_or_id, (0.0, _STRANGER))
        if now < until:
            return asker
        token = await asyncio.to_thread(self._look_up, secret_or_id)
        # Only good ones are remembered: wrong ones come without number.
        if token is None:
            self._believed.pop(secret_or_id, None)
            return _STRANGER
        asker = (token.id, token.scopes)
        self._believed[secret_or_id] = (now + BELIEVED_SECONDS, asker)
        return asker

    def _signed_in(self, headers: Headers) -> str | None:
        cookie = cookie_parser(headers.get("cookie", "")).get(self._seal.cookie)
        return None if cookie is None else self._seal.open(cookie, now=self._clock())


class BodyLimit:
    """Turn away requests with more than `MAX_BODY_BYTES`, announced or not.

    `large`: bytes that a request may have which brings a file.
    """

    def __init__(self, app: ASGIApp, large: int) -> None:
        self._app = app
        self._large = large

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit, refusal = MAX_BODY_BYTES, _too_large(scope["path"])
        if scope["method"] == "POST" and _LARGE.fullmatch(scope["path"]):
            limit = self._large + ENVELOPE_BYTES
            refusal = upload_too_large(self._large)
        headers = Headers(scope=scope)
        announced = headers.get("content-length", "0")
        waits = headers.get("expect", "").lower() == "100-continue"
        if announced.isdecimal() and int(announced) > limit:
            answer = problem(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, refusal)
            # One that waits for a word before it sends has not sent anything yet.
            if waits:
                await answer(scope, receive, send)
            else:
                await _answered_before_the_end(answer, scope, receive, send)
            return
        received = 0

        async def counting() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                if message.get("more_body"):
                    await _drained(receive)
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, refusal)
            return message

        await self._app(scope, counting, send)


async def _answered_before_the_end(
    answer: ASGIApp, scope: Scope, receive: Receive, send: Send
) -> None:
    """Answer at once, and read what is left of the body before the answer is said to be over.

    Whoever has announced too much need not send it to hear so; whoever sends it finds the
    connection open, and the answer when all is sent.
    """

    async def unended(message: Message) -> None:
        await send({**message, "more_body": True} if "body" in message else message)

    await answer(scope, receive, unended)
    await _drained(receive)
    await send({"type": "http.response.body"})


async def _drained(receive: Receive) -> None:
    """Read what is left of a body and throw it away, up to a point.

    Most clients read no answer before they have sent all: without this, they would see the
    connection break instead of the sentence.
    """
    left = DRAINED_BYTES
    with suppress(TimeoutError):
        async with asyncio.timeout(DRAINED_SECONDS):
            while left > 0:
                message = await receive()
                left -= len(message.get("body", b""))
                if not message.get("more_body"):
                    return


#: Requests that bring files.
_LARGE = re.compile(r"/v1/sessions|/v1/models|/v1/analyses|/v1/close-loops/[^/]+/report")


def _too_large(path: str) -> str:
    instead = ": post results in smaller batches" if path == "/v1/results" else ""
    return f"a request may have {MAX_BODY_BYTES} bytes at most{instead}"


def upload_too_large(limit: int) -> str:
    """Say that a session, what was found in one, a model or a table has more than `limit` bytes."""
    return f"an upload may have {limit} bytes at most (REHYB_SESSION_BYTES)"


def _let_in(scope: Scope) -> None:
    """Tell the connection, if there is one, that whoever is at its other end is no stranger."""
    connection = scope.get("rehyb.connection")
    if connection is not None:
        connection.signed_in()


#: What a stranger hears who sent no token, and who sent one; not whether it ever was a good one.
_NEEDED = "send the header `Authorization: Bearer TOKEN` with the coordinator's token"
_REFUSED = (
    "this token is refused: it is unknown or revoked; take the coordinator's own, REHYB_TOKEN "
    "there, or one that `rehyb token create NAME --scope SCOPE` makes there"
)


def _sign_in_first(scope: Scope, headers: Headers, sentence: str) -> ASGIApp:
    """Return the answer to a stranger: the page to sign in at to a reader, else 401."""
    path = scope["path"]
    if scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
        query = scope.get("query_string", b"").decode("latin-1")
        there = quote(path) + ("?" + query if query else "")
        return RedirectResponse(f"/sign-in?next={quote(there, safe='')}", HTTPStatus.SEE_OTHER)
    return problem(
        HTTPStatus.UNAUTHORIZED,
        sentence,
        headers={"WWW-Authenticate": "Bearer"},
    )


def _borne_by(headers: Headers) -> bytes | None:
    """Return the token a request bears; None if it bears none."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    # Headers are decoded as Latin-1: encoding them so gives the bytes that were sent.
    return token.strip().encode("latin-1") if scheme.lower() == "bearer" else None
