"""The cable between a coordinator and its database: cut, or silent, as nobody notices."""

import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress

import sqlalchemy as sa


class Cable:
    """Carries TCP connections from a port of its own to a port of this machine.

    Args:
        url: of a database, SQLAlchemy's; `url` is then the way to it over this cable.
        on_connection: is told the number of each new connection, from 1, before it is served.
    """

    def __init__(self, url: str, on_connection: Callable[[int], object] = lambda _: None) -> None:
        there = sa.make_url(url)
        assert there.port is not None
        self._target = there.port
        self._on_connection = on_connection
        self._listener = socket.create_server(("127.0.0.1", 0))
        port = self._listener.getsockname()[1]
        self.url = there.set(port=port).render_as_string(hide_password=False)
        self.connections = 0
        #: It carries nothing and tells nobody, as where packets are dropped on the way.
        self.silent = False
        #: Connections are reset, and no new one comes about.
        self._is_cut = False
        self._ends: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Reset all connections, and refuse new ones until `mend`."""
        self._is_cut = True
        for end in [*self._ends]:
            _reset(end)
        self._ends.clear()

    def mend(self) -> None:
        """Carry again; what was swallowed stays lost, with the connections that it was part of."""
        silent, self.silent = self.silent, False
        if silent:
            self.cut()
        self._is_cut = False

    def close(self) -> None:
        """Cut it for good."""
        self.cut()
        # Closed alone it listens on for as long as a thread waits in accept.
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                self.connections += 1
                self._ends.append(here)
                self._on_connection(self.connections)
                if self._is_cut or here not in self._ends:
                    _reset(here)
                    continue
                with suppress(OSError):
                    there = socket.create_connection(("127.0.0.1", self._target))
                    self._ends.append(there)
                    for way in ((here, there), (there, here)):
                        threading.Thread(target=self._carry, args=way, daemon=True).start()
                    continue
                _reset(here)

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                if not self.silent:
                    target.sendall(data)
        if not self.silent:
            with suppress(OSError):
                target.shutdown(socket.SHUT_WR)


def _reset(end: socket.socket) -> None:
    with suppress(OSError):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        # So that who waits for it notices: to close alone takes nothing from another thread.
        end.shutdown(socket.SHUT_RDWR)
    end.close()
