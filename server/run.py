"""Run a coordinator in this process."""

import asyncio
import errno
import gc
import signal
import socket
import threading
from typing import Any

import uvicorn
from fastapi import FastAPI

from server.app import create_app, open_database
from server.errors import BadSettingError, ConflictError, CoordinatorError
from server.http.connections import SPEAKER, ImpatientProtocol, strangers
from server.instance_lock import instance_lock
from server.logs import configure
from server.operations.check import refuse_damage
from server.settings import AN_ADDRESS, Settings
from server.store import upgrade
from server.store.database.presence import once_there

#: Seconds a stopping coordinator gives requests under way.
GRACE_SECONDS = 10
#: Seconds that a look for damage may keep a coordinator from starting; a large file takes longer.
CHECK_SECONDS = 10.0
#: New objects after which Python looks for garbage in circles. Its own 700 are those of a few
#: requests under way, which go without it.
GARBAGE = 10_000
#: How whoever starts a coordinator says where it listens: `rehyb up` starts one, too.
_PORT = "REHYB_PORT (--port of `rehyb up`)"


def serve(settings: Settings) -> None:
    """Bring the database up to date and serve until SIGTERM or SIGINT, then return.

    A database server that is not there yet is waited for, which is logged.

    Prints `listening on http://HOST:PORT` to standard output once connections are accepted.

    Raises:
        SchemaError: the database was made by a newer version.
        ConflictError: another coordinator serves the same SQLite file, or something else listens
            where this one should.
        DamagedError: the SQLite file has damaged pages.
        BadSettingError: the address is none of this machine's, or the port is not for this user.
    """
    configure(settings.log_level)
    stop = threading.Event()

    def heed(number: int, _: object) -> None:
        stop.set()
        # Who asks again does not want to wait for what is under way.
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, heed)
    with instance_lock(settings.database_url):
        app = create_app(settings)
        try:
            _make_ready(app, settings.database_url, stop)
            if not stop.is_set():
                _serve(app, settings)
        finally:
            app.state.engine.dispose()


def _make_ready(app: FastAPI, url: str, stop: threading.Event) -> None:
    def look() -> None:
        refuse_damage(url, seconds=CHECK_SECONDS)
        upgrade(url)
        # Here, not when the server starts: who goes in between is waited for again.
        open_database(app.state)

    once_there(app.state.engine, look, stop=stop)


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens; a CoordinatorError says which setting keeps it from that."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except UnicodeError:
        # A name with a part that is empty or too long.
        raise _objection(OSError(errno.EADDRNOTAVAIL, ""), host, port) from None
    except OSError as error:
        raise _objection(error, host, port) from None


def _objection(error: OSError, host: str, port: int) -> CoordinatorError:
    # Below zero: of a name that nobody knows.
    if error.errno == errno.EADDRNOTAVAIL or (error.errno or 0) < 0:
        return BadSettingError(f"REHYB_HOST must be {AN_ADDRESS}, not {host[:40]!r}")
    if error.errno == errno.EADDRINUSE:
        return ConflictError(
            f"something else listens on port {port} of {host}: stop it, or set {_PORT} to another "
            "one (0: any that is free)"
        )
    if error.errno == errno.EACCES:
        return BadSettingError(
            f"this user may not listen on port {port}: set {_PORT} to one from 1024 on"
        )
    return CoordinatorError(f"nobody can listen on port {port} of {host}: {error.strerror}")


def _serve(app: FastAPI, settings: Settings) -> None:
    with listening(settings.host, settings.port) as listener:
        # Connections inherit it. Without it, Nagle's algorithm and delayed acknowledgements hold
        # every answer back for 40 ms.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        app.state.strangers = strangers()
        config = uvicorn.Config(
            app,
            http=_AnsweringAtOnce,
            headers=[SPEAKER],
            access_log=False,
            log_config=None,
            ssl_certfile=settings.tls_certificate,
            ssl_keyfile=settings.tls_key,
            timeout_graceful_shutdown=GRACE_SECONDS,
        )
        server = _AnnouncingServer(config)
        # Uvicorn raises the signal that stopped it once more when it is done; with its own handler
        # in place of the default one that is harmless, and this function returns.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, server.handle_exit)
        server.run(sockets=[listener])
    if not server.started:
        raise SystemExit(1)


def leave_alone_what_stays() -> None:
    """Have Python look for garbage among what is new from now on, and less often.

    To look at all that a coordinator consists of takes it a twentieth of a second, in which it
    answers nobody.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(GARBAGE)


class WholeAnswers:
    """A transport that sends head and body of an answer in one packet: uvicorn writes them apart.

    Two would cost the coordinator a system call more, and wake the worker twice.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._held = b""

    def write(self, data: bytes) -> None:
        """Send `data` with what comes next, which must come before the event loop goes on."""
        if self._held:
            self._held += data
            self._send()
        elif data:
            self._held = data
            asyncio.get_running_loop().call_soon(self._send)

    def close(self) -> None:
        """Close the connection when everything is sent."""
        self._send()
        self._transport.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def _send(self) -> None:
        held, self._held = self._held, b""
        if held and not self._transport.is_closing():
            self._transport.write(held)


class _AnsweringAtOnce(ImpatientProtocol):
    """HTTP with `WholeAnswers`."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to serve a connection."""
        super().connection_made(WholeAnswers(transport))  # type: ignore[arg-type]


class _AnnouncingServer(uvicorn.Server):
    """A server that says when it listens, and where."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams first, which would otherwise be waited for."""
        self.config.app.state.stopping.set()  # type: ignore[union-attr]
        await super().shutdown(sockets)
        if self.force_exit:
            # Uvicorn leaves that out for who asks twice, and the loop's end would cut it off in the
            # midst, with a traceback; it takes as long.
            await self.lifespan.shutdown()

    async def on_tick(self, counter: int) -> bool:
        """Close, once a second, who has kept the coordinator waiting for too long."""
        if counter % 10 == 0:
            now = asyncio.get_running_loop().time()
            for connection in [*self.server_state.connections]:
                if isinstance(connection, ImpatientProtocol) and connection.is_overdue(now):
                    connection.give_up()
        return await super().on_tick(counter)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        leave_alone_what_stays()
        if self.started and sockets:
            host, port = sockets[0].getsockname()[:2]
            scheme = "https" if self.config.is_ssl else "http"
            print(
                f"listening on {scheme}://{f'[{host}]' if ':' in host else host}:{port}", flush=True
            )
