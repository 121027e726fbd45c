"""One connection to a coordinator: its token, its errors, and bodies both ways."""

import gzip
import json
import os
import re
import ssl
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from http import HTTPStatus
from math import inf
from pathlib import Path
from typing import Any, BinaryIO, Self

import httpx2

from models.tokens import usable
from rehyb.client.wire import (
    Answer,
    HungUpError,
    NotHttpError,
    Wire,
    answered,
    is_plain,
    speaks_tls,
)
from rehyb.errors import (
    WRONG_PATHS,
    Invalid,
    NotFound,
    RehybError,
    ServerError,
    Unauthorized,
    Unreachable,
    WrongProtocol,
    refusal,
)
from rehyb.whole_files import whole_file

Json = dict[str, Any]
Body = Mapping[str, Any] | None
Headers = Mapping[str, str] | None

#: `json.dumps` would make a new one for every body.
_JSON = json.JSONEncoder(allow_nan=False, separators=(",", ":"))
#: A place in a body is named to so many parts.
_DEEPEST = 20
#: Bodies longer than this are sent compressed.
COMPRESS_BYTES = 50_000
DEFAULT_URL = "http://127.0.0.1:8787"
#: What ids are made of, and names of models with their digest.
_ID = re.compile(r"[A-Za-z0-9_@-]+")
#: Seconds that a session may take to be looked at, or a report to be stored.
UPLOAD_SECONDS = 300.0
#: Seconds that a look may take at whether TLS is spoken.
LOOK_SECONDS = 5.0
#: Never asked of a proxy, whatever the environment says.
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Connection:
    """What every call to a coordinator goes through; `rehyb.Client` says what can be called."""

    def __init__(
        self,
        url: str | None = None,
        token: str | None = None,
        timeout: float = 30.0,
        *,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        self.url = (url or os.environ.get("REHYB_URL") or DEFAULT_URL).rstrip("/")
        try:
            #: What every request bears.
            self.token = usable(token or os.environ.get("REHYB_TOKEN") or "")
        except ValueError as error:
            raise Unauthorized(str(error)) from None
        if not self.token:
            raise Unauthorized(
                f"there is no token for {self.url}: set REHYB_TOKEN to the coordinator's token"
            )
        #: Seconds the coordinator last asked a worker without work to wait before asking again.
        self.retry_after = 1.0
        #: No answer is waited for beyond this time of the monotonic clock.
        self.answer_by = inf
        self._timeout = timeout
        #: Whether anything there has ever answered in HTTP.
        self._answered = False
        headers = {"Authorization": f"Bearer {self.token}"}
        try:
            address = httpx2.URL(self.url)
            if address.scheme not in ("http", "https") or not address.host:
                raise Invalid(
                    f"{self.url} is not a coordinator's address: it begins with http:// or "
                    "https://, and a host follows"
                )
            direct = address.host in LOOPBACK
            self._http = httpx2.Client(
                base_url=self.url,
                headers=headers,
                timeout=timeout,
                transport=transport,
                # Without TLS no certificates are looked at; to load them takes longer than a call.
                verify=address.scheme != "http",
                trust_env=not direct,
            )
        except (httpx2.InvalidURL, UnicodeError) as error:
            raise Invalid(f"{self.url} is not a coordinator's address: {error}") from error
        plain = transport is None and is_plain(address, direct=direct)
        #: For what is asked over and over; None: by `_http` as everything else.
        self._wire = Wire(address, headers) if plain else None
        # A worker asks for the same few all the time: to join and check one is an eighth of a call.
        self._address = lru_cache(maxsize=64)(self._join)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        if self._wire is not None:
            self._wire.close()
        self._http.close()

    def _json(self, method: str, path: str, body: Body = None, headers: Headers = None) -> Json:
        return body_of(self._request(method, path, body, headers))

    def _leased(self, path: str, body: Body) -> Json | None:
        """Ask for a lease; None, with `retry_after` set, if there is no work for now."""
        response = self._request("POST", path, body)
        if response.status_code == HTTPStatus.NO_CONTENT:
            self._note_pause(response)
            return None
        return body_of(response)

    def _note_pause(self, response: Answer) -> None:
        seconds = response.header("Retry-After")
        self.retry_after = float(seconds) if seconds.isdigit() else 1.0

    def _request(
        self, method: str, path: str, body: Body = None, headers: Headers = None
    ) -> Answer:
        response = self._send(method, path, body, headers)
        if not response.is_success:
            raise error_of(response)
        return response

    def _send(self, method: str, path: str, body: Body = None, headers: Headers = None) -> Answer:
        try:
            address = self._address(path)
            if body is None:
                return self._ask(method, address, headers or {})
            content = written(body)
            headers = {"Content-Type": "application/json", **(headers or {})}
            if len(content) > COMPRESS_BYTES:
                content = gzip.compress(content, compresslevel=1)
                headers["Content-Encoding"] = "gzip"
            return self._ask(method, address, headers, content)
        except (httpx2.TransportError, httpx2.DecodingError, OSError) as error:
            raise self._unreachable(error) from error
        except httpx2.InvalidURL as error:
            raise Invalid(f"{path[:80]!r} is no address at {self.url}: {error}") from error
        except ValueError as error:
            raise Invalid(f"the request cannot be written as JSON: {error}") from error

    def _ask(
        self, method: str, url: httpx2.URL, headers: Mapping[str, str], content: bytes = b""
    ) -> Answer:
        timeout = self._patience(self._timeout)
        if self._wire is not None:
            found = self._wire.request(method, url, headers, content, timeout=timeout)
        else:
            found = answered(
                self._http.request(
                    method, url, content=content or None, headers=headers, timeout=timeout
                )
            )
        return self._heard(found)

    def _heard(self, answer: Answer) -> Answer:
        """Return a coordinator's answer, or a refusal by anybody: `error_of` tells these apart.

        Raises:
            WrongProtocol: who says that it is done is no coordinator.
        """
        self._answered = True
        if answer.is_success and not answer.is_coordinators:
            raise WrongProtocol(
                f"{self.url} answers, but is no coordinator of rehyb; set REHYB_URL to its address"
            )
        return answer

    def _patience(self, seconds: float) -> float:
        """Return how long to wait for the other side, `seconds` at most.

        Raises:
            TimeoutError: not at all.
        """
        if self.answer_by == inf:
            return seconds
        left = self.answer_by - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("there is no time left to ask")
        return min(seconds, left)

    def _join(self, path: str) -> httpx2.URL:
        """Return the address of a path at the coordinator."""
        return self._http.build_request("GET", path).url

    def _unreachable(self, error: Exception) -> Unreachable:
        if found := wrong_protocol(error, self.url) or self._lacks_tls(error):
            return WrongProtocol(f"no coordinator answers at {self.url}: {found}")
        cause = str(error) or type(error).__name__
        return Unreachable(
            f"no coordinator answers at {self.url} ({cause}): start one with `rehyb up`, "
            "or set REHYB_URL to where it listens"
        )

    def _lacks_tls(self, error: Exception) -> str | None:
        """Say what to write if what has hung up waits for TLS; None if it does not.

        One that has answered before is being restarted, which need not be disturbed.
        """
        if self._answered or not isinstance(error, HungUpError):
            return None
        address = self._http.base_url
        if not speaks_tls(address.host, address.port or 80, min(self._timeout, LOOK_SECONDS)):
            return None
        return f"what listens there speaks TLS: write https{self.url.removeprefix('http')}"

    def _download(
        self, path: str, target: Path | str, on_chunk: Callable[[], object] = lambda: None
    ) -> None:
        """Write what `path` answers to `target`; a download cut short leaves no file behind."""
        file_at = as_path(target)
        try:
            with (
                paths_refused(),
                self._http.stream("GET", path, timeout=self._patience(self._timeout)) as response,
                whole_file(file_at) as partial,
                partial.open("wb") as file,
            ):
                self._heard(Answer(response.status_code, b"", path, response.headers.raw))
                if response.status_code != HTTPStatus.OK:
                    response.read()
                    raise error_of(answered(response))
                for chunk in response.iter_bytes():
                    file.write(chunk)
                    on_chunk()
                    self._patience(self._timeout)
        except (httpx2.TransportError, TimeoutError) as error:
            raise self._unreachable(error) from error

    def _post(self, path: str, **content: Any) -> Json:
        """Post files, which may take UPLOAD_SECONDS to be dealt with.

        `content`: content, files, params and headers as httpx2 takes them.
        """
        try:
            timeout = self._patience(UPLOAD_SECONDS)
            response = self._heard(answered(self._http.post(path, timeout=timeout, **content)))
        except (httpx2.TransportError, TimeoutError) as error:
            raise self._unreachable(error) from error
        if not response.is_success:
            raise error_of(response)
        return body_of(response)


def written(body: Mapping[str, Any]) -> bytes:
    """Return a body as JSON; Invalid names the place of what JSON does not have."""
    try:
        return _JSON.encode(body).encode()
    except (TypeError, ValueError) as error:
        place = "".join(_faulty(body, _DEEPEST))
        said = f"{place}: {error}" if place else str(error)
        raise Invalid(f"the request cannot be written as JSON: {said}") from error


def _faulty(body: Any, deep: int) -> Iterator[str]:
    """Yield the parts of a pointer to the first value that cannot be written.

    `deep`: to how many parts, since what is in itself has no end.
    """
    inner: Iterable[tuple[Any, Any]] = ()
    if isinstance(body, dict):
        inner = body.items()
    elif isinstance(body, list | tuple):
        inner = enumerate(body)
    for key, value in inner:
        try:
            _JSON.encode(value)
        except (TypeError, ValueError):
            yield f"/{key}"
            if deep > 1:
                yield from _faulty(value, deep - 1)
            return


def as_path(path: Path | str) -> Path:
    """Return a path that somebody gave; Invalid if it is none."""
    try:
        return Path(path)
    except TypeError:
        kind = type(path).__name__
        raise Invalid(f"a path is a text or a pathlib.Path, not {kind}") from None


@contextmanager
def for_reading(path: Path | str) -> Iterator[BinaryIO]:
    """Open a file that somebody named; Invalid if there is none to be read."""
    with paths_refused(), as_path(path).open("rb") as file:
        yield file


@contextmanager
def paths_refused() -> Iterator[None]:
    """Within the block, a path that is not there, or not what is taken, is Invalid."""
    try:
        yield
    except WRONG_PATHS as error:
        raise Invalid(f"{error.filename}: {error.strerror}") from error


def path_of(place: str, its_id: str, *below: object) -> str:
    """Return the path of what has an id at a place, as "studies", or of something below it.

    Raises:
        Invalid: it is no text.
        NotFound: nothing there has such an id. It is not asked about: servers turn %2F back into a
            slash before they look which route it is, so no quoting makes one part of it.
    """
    one = "study" if place == "studies" else place.removesuffix("s")
    if not isinstance(its_id, str):
        raise Invalid(f"the id of a {one} is a text, not {type(its_id).__name__}")
    if not _ID.fullmatch(its_id):
        raise NotFound(f"there is no {one} {its_id[:80]!r}")
    return "/".join(("/v1", place, its_id, *map(str, below)))


def body_of(response: Answer) -> Json:
    """Return the JSON object that an answer holds; ServerError if it holds none."""
    try:
        body = response.json()
    except ValueError:
        body = None
    if not isinstance(body, dict):
        raise ServerError(f"{response.url} did not answer with a JSON object")
    return body


def wrong_protocol(error: Exception, url: str) -> str | None:
    """Say what is wrong if something answers that is no coordinator; None if nothing does.

    `url`: what was asked.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, NotHttpError):
            return f"what listens there does not speak HTTP ({cause})"
        if isinstance(cause, ssl.SSLCertVerificationError):
            why = cause.verify_message
            return f"its certificate is not trusted ({why}); SSL_CERT_FILE names one that is"
        if isinstance(cause, ssl.SSLError) and cause.reason == "WRONG_VERSION_NUMBER":
            plain = url.removeprefix("https")
            return f"what listens there does not speak TLS: write http{plain}"
        cause = cause.__cause__ or cause.__context__
    return None


def error_of(response: Answer) -> RehybError:
    """Turn a refusal into the error that a caller can tell apart, worded by the coordinator."""
    try:
        # What another server says in JSON is not for who asked a coordinator.
        problem = response.json() if response.is_coordinators else None
    except ValueError:
        problem = None
    location = response.header("Location")
    return refusal(response.status_code, problem, response.url, location=location)
