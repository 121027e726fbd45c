"""Signing in: a one-time code or a token becomes a cookie."""

import asyncio
import hmac
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from pydantic import Field

from server.http.problems import problem
from server.logic.signing_in import OPERATOR, SIGNED_IN_SECONDS, Seal, comes_from_here
from server.logic.tokens import FAILURE_SECONDS, Believed, Failures, may
from server.operations import sign_in_codes, tokens
from server.routes.common import Body, Now, Route, Store
from server.web.assets import page_headers, render

router = APIRouter(route_class=Route)


class SignIn:
    """What one coordinator knows of those who sign in.

    Args:
        token: the operator's own.
    """

    def __init__(self, token: str) -> None:
        self.token = token.encode()
        self.seal = Seal(token)
        self.failures = Failures()
        #: Tokens that were good, which `Guard` keeps.
        self.believed: Believed = {}


class SignInBody(Body):
    """What somebody signs in with."""

    token: str | None = Field(default=None, max_length=1000)
    code: str | None = Field(default=None, max_length=100)


@router.post("/v1/sign-in-codes", status_code=201, tags=["signing in"])
def code(request: Request, store: Store, now: Now) -> dict[str, Any]:
    """Make a code that signs in a browser once, within an hour, with the rights of the asker.

    Of those of one token that nobody has used the latest hundred are kept.
    """
    made = sign_in_codes.new(store, request.scope["rehyb.who"], now=now)
    return {"code": made, "path": f"/sign-in#{made}"}


@router.get("/sign-in", include_in_schema=False)
async def form() -> HTMLResponse:
    """Show the page to sign in at."""
    return HTMLResponse(render("sign_in.html"), headers=page_headers())


@router.post("/sign-in", include_in_schema=False)
async def sign_in(body: SignInBody, request: Request, store: Store, now: Now) -> Response:
    """Sign a browser in."""
    knows: SignIn = request.app.state.sign_in
    if not comes_from_here(request.headers):
        return problem(HTTPStatus.FORBIDDEN, "only this coordinator's own page signs in")
    if body.token is None and body.code is None:
        return problem(HTTPStatus.UNPROCESSABLE_ENTITY, "send token or code")
    address = request.client.host if request.client else ""
    secret = (body.token or "").strip().encode()
    operator = hmac.compare_digest(secret, knows.token)
    # Who has a good token must not suffer from what others send from the same address.
    known = operator or secret in knows.believed
    if not known and knows.failures.too_many(address, now):
        return problem(
            HTTPStatus.TOO_MANY_REQUESTS,
            f"too many wrong tokens came from this address: wait {FAILURE_SECONDS:.0f} s",
        )
    who: str | None = None
    scopes: Sequence[str] = ()
    look_for: bytes | str | None = secret or None
    if body.code is not None:
        look_for = await asyncio.to_thread(sign_in_codes.take, store, body.code, now=now)
        operator = look_for == OPERATOR
    if operator:
        who, scopes = OPERATOR, ("admin",)
    elif look_for and (found := await asyncio.to_thread(tokens.good, store, look_for)):
        who, scopes = found.id, found.scopes
    if who is None:
        knows.failures.count(address, now)
        return problem(
            HTTPStatus.UNAUTHORIZED,
            "this code was used already, is older than an hour or its token was revoked: "
            "sign in with a token"
            if body.code is not None
            else "this is no token of this coordinator, or it was revoked",
        )
    if not may(scopes, ("read",)):
        return problem(
            HTTPStatus.FORBIDDEN,
            "pages need a token with the scope read or admin; this one has " + ", ".join(scopes),
        )
    if body.code is None and who != OPERATOR:
        # To be looked up again, but not to be turned away unasked.
        knows.believed.setdefault(secret, (0.0, (who, tuple(scopes))))
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    response.set_cookie(
        knows.seal.cookie,
        knows.seal.close(who, until=now + SIGNED_IN_SECONDS),
        max_age=int(SIGNED_IN_SECONDS),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return response


@router.post("/sign-out", include_in_schema=False)
async def sign_out(request: Request) -> Response:
    """Forget a browser's sign-in."""
    if not comes_from_here(request.headers):
        return problem(HTTPStatus.FORBIDDEN, "only this coordinator's own page signs out")
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    response.delete_cookie(request.app.state.sign_in.seal.cookie)
    return response
