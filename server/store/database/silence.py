"""PostgreSQL that is silent: at work, or gone without a word, as nobody can tell from here.

The network notices a server that vanished by what is not acknowledged any more, which
`NETWORK_LIMITS` make a matter of seconds. It does not notice one behind a proxy or a firewall that
swallows what it acknowledges, nor a process that stands still. So whoever waits for long asks
whether the server takes connections: one that does is waited for on.
"""

import socket
import struct
from collections.abc import Generator
from time import monotonic
from typing import Any, TypeVar

import psycopg
from psycopg import pq

T = TypeVar("T")

#: Parameters of libpq (PostgreSQL's documentation, 34.1.2; by themselves they are those of the
#: system, two hours of silence and a quarter of an hour without acknowledgement, tcp(7)). A worker
#: waits 30 s for an answer: who notices later notices for nobody.
NETWORK_LIMITS = {
    # Seconds, of one address.
    "connect_timeout": 5,
    # A connection on which nothing was heard for 10 s is dead if it is silent for 10 s more.
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 2,
    # Milliseconds.
    "tcp_user_timeout": 20_000,
}
#: Seconds without a word of the server after which somebody looks whether it is there, again and
#: again; and seconds that it may take to answer that.
SILENT_SECONDS, LOOK_SECONDS = 3.0, 5.0
#: Seconds that one answer may take in any case: a statement over the instances of the largest study
#: takes minutes, and a trip of a turn milliseconds.
LONGEST_SECONDS, TRIP_SECONDS = 3600.0, 60.0
#: Asks in the protocol's first message whether TLS is spoken (PostgreSQL's documentation, 54.7).
#: Whoever takes connections answers that with a byte, and says nothing in its log.
_SSL_REQUEST = struct.pack("!ii", 8, 80877103)


class SilentError(psycopg.OperationalError):
    """A server was silent for too long, and its connection was given up."""

    #: Known by this where no driver is.
    is_silent = True


#: Where a server listens: its address, or the folder of its socket, and its port.
Place = tuple[str, int]


def place_of(raw: pq.abc.PGconn) -> Place:
    """Return where a connection leads to."""
    return (raw.hostaddr or raw.host).decode(), int(raw.port)


def why_given_up(place: Place, waited: float, longest: float) -> str | None:
    """Look whether a server that is silent is there; return why it is given up, if it is.

    Args:
        place: where it listens.
        waited: seconds that its answer has taken.
        longest: seconds that it may take.
    """
    if waited >= longest:
        return f"it did not answer for {waited:.0f} s"
    if not takes_connections(*place):
        return f"it is silent for {waited:.0f} s, and its server takes no connections"
    return None


def takes_connections(host: str, port: int) -> bool:
    """Say whether a server takes connections there, see `Place`."""
    try:
        if host.startswith(("/", "@")):
            there = socket.socket(socket.AF_UNIX)
            there.settimeout(LOOK_SECONDS)
        else:
            there = socket.create_connection((host, port), LOOK_SECONDS)
        with there:
            if there.family == socket.AF_UNIX:
                there.connect(f"{host}/.s.PGSQL.{port}".replace("@", "\0", 1))
            there.sendall(_SSL_REQUEST)
            return bool(there.recv(1))
    except OSError:
        return False


class WatchedConnection(psycopg.Connection[Any]):
    """A connection of the driver on which nobody waits for a server that is gone."""

    def wait(self, gen: Generator[Any, Any, T], *given: Any, **named: Any) -> T:
        """Wait until something is done, as the driver does.

        Raises:
            SilentError: the server is given up, and the connection with it.
        """
        return super().wait(self._watched(gen), *given, **named)

    def _watched(self, gen: Generator[Any, Any, T]) -> Generator[Any, Any, T]:
        begun = heard = monotonic()
        try:
            wanted = next(gen)
            while True:
                # The driver comes back ten times a second, with nothing if nothing happened.
                ready = yield wanted
                now = monotonic()
                if ready:
                    heard = now
                elif now - heard >= SILENT_SECONDS:
                    why = why_given_up(place_of(self.pgconn), now - begun, LONGEST_SECONDS)
                    if why is not None:
                        self.pgconn.finish()
                        raise SilentError(why)
                    heard = monotonic()
                wanted = gen.send(ready)
        except StopIteration as end:
            done: T = end.value
            return done


def connect(*given: Any, **named: Any) -> WatchedConnection:
    """Connect as the driver does, within `NETWORK_LIMITS` unless `named` has others.

    Raises:
        SilentError: nobody answered.
    """
    try:
        return WatchedConnection.connect(*given, **{**NETWORK_LIMITS, **named})
    except psycopg.errors.ConnectionTimeout as error:
        raise SilentError("its server does not answer") from error
