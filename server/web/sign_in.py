"""Signing in: a one-time code or a token becomes a cookie."""

import asyncio
import hmac
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from pydantic import Field

from server.logic.signing_in import OPERATOR, SIGNED_IN_SECONDS, Codes, Seal, comes_from_here
from server.logic.tokens import FAILURE_SECONDS, Failures
from server.operations import tokens
from server.problems import problem
from server.routes.common import Body, Now, Store
from server.web.assets import page_headers, render

router = APIRouter()


class SignIn:
    """What one coordinator knows of those who sign in.

    Args:
        token: the operator's own.
    """

    def __init__(self, token: str) -> None:
        self.token = token.encode()
        self.seal = Seal(token)
        self.codes = Codes()
        self.failures = Failures()


class SignInBody(Body):
    """What somebody signs in with."""

    token: str | None = Field(default=None, max_length=1000)
    code: str | None = Field(default=None, max_length=100)


@router.post("/v1/sign-in-codes", status_code=201, tags=["signing in"])
async def code(request: Request, now: Now) -> dict[str, Any]:
    """Make a code that signs in a browser once, within an hour, with the rights of the asker."""
    knows: SignIn = request.app.state.sign_in
    made = knows.codes.new(request.scope["rehyb.who"], now=now)
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
    address = request.client.host if request.client else ""
    if knows.failures.too_many(address, now):
        return problem(
            HTTPStatus.TOO_MANY_REQUESTS,
            f"too many wrong tokens came from this address: wait {FAILURE_SECONDS:.0f} s",
        )
    who = None
    if body.code is not None:
        who = knows.codes.take(body.code, now=now)
    elif body.token is not None:
        secret = body.token.strip().encode()
        if hmac.compare_digest(secret, knows.token):
            who = OPERATOR
        elif found := await asyncio.to_thread(tokens.good, store, secret):
            who = found.id
    if who is None:
        knows.failures.count(address, now)
        return problem(
            HTTPStatus.UNAUTHORIZED,
            "this code was used already or is older than an hour: sign in with a token"
            if body.code is not None
            else "this is no token of this coordinator, or it was revoked",
        )
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
