"""Where it listens; answers leave in one piece, and no look for garbage keeps them waiting."""

import asyncio
import errno
import gc
import os
import socket
from collections.abc import Callable

import pytest

from server.errors import BadSettingError, ConflictError, CoordinatorError
from server.run import WholeAnswers, leave_alone_what_stays, listening


class Wire:
    """A transport that keeps what is written to it."""

    def __init__(self) -> None:
        self.packets: list[bytes] = []
        self.closed = False

    def write(self, data: bytes) -> None:
        self.packets.append(data)

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True


def sent(speak: Callable[[WholeAnswers], None]) -> Wire:
    """Return the wire after `speak` wrote to it, and the event loop went on."""
    wire = Wire()

    async def serve() -> None:
        speak(WholeAnswers(wire))  # type: ignore[arg-type]
        await asyncio.sleep(0)

    asyncio.run(serve())
    return wire


def test_head_and_body_are_one_packet() -> None:
    def speak(transport: WholeAnswers) -> None:
        transport.write(b"head ")
        transport.write(b"body")

    assert sent(speak).packets == [b"head body"]


def test_what_nothing_follows_is_sent_all_the_same() -> None:
    assert sent(lambda transport: transport.write(b"event")).packets == [b"event"]


def test_a_long_answer_keeps_its_order_and_is_not_kept_back() -> None:
    def speak(transport: WholeAnswers) -> None:
        for part in (b"1", b"2", b"", b"3", b"4", b"5"):
            transport.write(part)
        assert transport.is_closing() is False

    assert b"".join(sent(speak).packets) == b"12345"


def test_closing_sends_what_is_held() -> None:
    def speak(transport: WholeAnswers) -> None:
        transport.write(b"last word")
        transport.close()

    wire = sent(speak)
    assert wire.packets == [b"last word"]
    assert wire.closed


def test_nothing_is_sent_to_who_has_gone() -> None:
    def speak(transport: WholeAnswers) -> None:
        transport.write(b"lost")
        transport.__getattr__("close")()

    assert sent(speak).packets == []


def test_garbage_is_looked_for_among_what_is_new_only() -> None:
    threshold, frozen = gc.get_threshold(), gc.get_freeze_count()
    here_before = object.__new__(type("Here", (), {}))
    try:
        leave_alone_what_stays()
        assert gc.get_freeze_count() > frozen
        assert not any(one is here_before for one in gc.get_objects())
        assert gc.get_threshold()[0] > threshold[0]
    finally:
        # To thaw what this test froze would thaw what the suite did (`tests/conftest.py`).
        gc.set_threshold(*threshold)


# 192.0.2.0/24 is of nobody (RFC 5737).
@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid", "[::1]", "http://a", "a..b"])
def test_an_address_that_is_not_of_this_machine_is_refused_by_its_setting(host: str) -> None:
    with pytest.raises(BadSettingError) as refused:
        listening(host, 0)
    assert str(refused.value) == (
        "REHYB_HOST must be an address or name of this machine, as 127.0.0.1, or 0.0.0.0 for all "
        f"of them, not {host!r}"
    )


def test_a_port_that_somebody_has_is_named_with_the_setting_that_takes_another() -> None:
    with listening("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        with pytest.raises(ConflictError) as refused:
            listening("127.0.0.1", port)
    assert str(refused.value) == (
        f"something else listens on port {port} of 127.0.0.1: stop it, or set REHYB_PORT "
        "(--port of `rehyb up`) to another one (0: any that is free)"
    )


@pytest.mark.parametrize(
    ("number", "kind", "sentence"),
    [
        (
            errno.EACCES,
            BadSettingError,
            "this user may not listen on port 80: set REHYB_PORT (--port of `rehyb up`) to one "
            "from 1024 on",
        ),
        (
            errno.EMFILE,
            CoordinatorError,
            "nobody can listen on port 80 of 127.0.0.1: Too many open files",
        ),
    ],
)
def test_what_else_keeps_it_from_listening_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch, number: int, kind: type[CoordinatorError], sentence: str
) -> None:
    def refuse(*_: object, **__: object) -> socket.socket:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(socket, "create_server", refuse)
    with pytest.raises(kind) as refused:
        listening("127.0.0.1", 80)
    assert str(refused.value) == sentence
