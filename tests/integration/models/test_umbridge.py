"""Our client finds its way with a server that speaks UM-Bridge, and our server answers as one."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import httpx2
import pytest

from models.evaluation import Evaluation, ModelAway, ModelFailure
from models.folder import ModelError, read_folder
from models.umbridge.client import RemoteModel, Server, ServerAwayError, answers
from models.umbridge.server import serve
from sim.evaluation import evaluate
from sim.models import ISHIGAMI
from tests.testbed.models import edited

TO_UMBRIDGE = {
    'kind = "command"': 'kind = "umbridge"',
    "[command]": "[umbridge]",
    'run = ["python3", "ishigami.py"]\nkeep = true': 'name = "ishigami"',
}


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Serve the Ishigami function, which fails at x1 = 3."""

    def failing(name: str, parameters: Any) -> Evaluation:
        if parameters["x1"] == 3.0:
            return Evaluation(outcome="diverged", outputs={}, reason="r", wall_seconds=0.0)
        return evaluate(name, parameters)

    server = serve({"ishigami": ISHIGAMI}, failing, "127.0.0.1", 0)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join()


def test_a_model_elsewhere_is_evaluated_as_if_it_were_here(url: str, tmp_path: Path) -> None:
    remote = RemoteModel(read_folder(edited("ishigami_python", tmp_path, TO_UMBRIDGE)), Server(url))
    x = {"x1": 0.3, "x2": 1.0, "x3": -2.0}
    assert remote(x) == evaluate("ishigami", x).outputs
    with pytest.raises(ModelFailure, match="diverged: r"):
        remote({"x1": 3.0})
    remote.close()


@pytest.mark.parametrize("kind", [httpx2.ConnectError, httpx2.ConnectTimeout])
def test_a_server_that_is_gone_says_nothing_of_a_point(
    kind: type[httpx2.TransportError], url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remote = RemoteModel(read_folder(edited("ishigami_python", tmp_path, TO_UMBRIDGE)), Server(url))
    assert answers(url) and not answers("http://127.0.0.1:1")

    def refused(*_: Any, **__: Any) -> None:
        raise kind("nobody there")

    monkeypatch.setattr(httpx2.Client, "stream", refused)
    with pytest.raises(ModelAway, match=f"{url}: nobody there"):
        remote({"x1": 0.3})
    with pytest.raises(ServerAwayError, match="no UM-Bridge server answers"):
        Server(url)
    remote.close()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "ishigami"', 'name = "other"', "has ishigami"),
        (
            '[[outputs]]\nname = "y"',
            '[[outputs]]\nname = "z"\nunit = "1"\n\n[[outputs]]\nname = "y"',
            "outputs are 2 numbers",
        ),
        ('name = "ishigami"', 'name = "ishigami"\nport = 3', "umbridge.port is unknown"),
    ],
)
def test_a_folder_that_does_not_fit_the_server_says_where(
    url: str, tmp_path: Path, old: str, new: str, words: str
) -> None:
    folder = edited("ishigami_python", tmp_path, TO_UMBRIDGE)
    toml = folder / "model.toml"
    toml.write_text(toml.read_text().replace(old, new))
    server = Server(url)
    with pytest.raises(ModelError, match=words):
        RemoteModel(read_folder(folder), server)
    server.close()


def test_what_is_no_server_says_so() -> None:
    with pytest.raises(ModelError, match="no UM-Bridge server answers"):
        Server("http://127.0.0.1:1")


@pytest.mark.parametrize(
    ("info", "words"),
    [
        ({}, "it tells no protocolVersion"),
        ({"protocolVersion": 0.9}, "speaks version 0.9, not 1.0"),
        ({"protocolVersion": 1.0, "models": 3}, "does not tell the names of its models"),
        ({"protocolVersion": 1.0, "models": [3]}, "does not tell the names of its models"),
    ],
)
def test_what_a_server_tells_of_itself_must_make_sense(
    info: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = httpx2.Response(200, json=info)
    monkeypatch.setattr(httpx2.Client, "stream", lambda *_, **__: nullcontext(answer))
    with pytest.raises(ModelError, match=words):
        Server("http://h")


LIES = {
    "negative": ({"inputSizes": [-1, 4]}, ModelError, "does not say how long the vectors of"),
    "true": ({"outputSizes": [True]}, ModelError, "does not say how long the vectors of"),
    "deep": ({"output": "[" * 100_000}, ModelFailure, "answered 200 without JSON"),
    "digits": ({"output": "[[" + "9" * 400 + "]]"}, ModelFailure, "must be a number"),
    "nothing": ({"output": "[[null]]"}, ModelFailure, "must be a number"),
    "flood": ({"output": " " * 6_000_000}, ModelFailure, "answered more than 5 MB"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_server_that_lies_is_told_so(
    lie: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, kind, words = LIES[lie]
    honest = {"protocolVersion": 1.0, "models": ["ishigami"], "support": {"Evaluate": True}}
    honest |= {"inputSizes": [3], "outputSizes": [1], "output": "[[1.0]]"}
    told: dict[str, Any] = honest | said
    output = told.pop("output")

    def stream(_: object, method: str, url: str, **__: Any) -> Any:
        body = f'{{"output": {output}}}' if url.endswith("Evaluate") else json.dumps(told)
        return nullcontext(httpx2.Response(200, content=body.encode()))

    monkeypatch.setattr(httpx2.Client, "stream", stream)
    with pytest.raises(kind, match=words):
        folder = read_folder(edited("ishigami_python", tmp_path, TO_UMBRIDGE))
        RemoteModel(folder, Server("http://h"))({"x1": 0.3})


def test_a_server_that_dribbles_is_left_when_time_is_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dribble() -> Iterator[bytes]:
        while True:
            yield b" "

    answer = httpx2.Response(200, content=dribble())
    monkeypatch.setattr(httpx2.Client, "stream", lambda *_, **__: nullcontext(answer))
    server = object.__new__(Server)
    server.url, server._http = "http://h", httpx2.Client()
    with pytest.raises(ModelFailure, match="gave no answer in time"):
        server.evaluate("ishigami", [[0.3]], {}, 0.05)


@pytest.mark.parametrize("length", ["\xb2", "9" * 5000, "-1", ""])
def test_a_length_that_is_none_is_refused(length: str, url: str) -> None:
    host, _, port = url.removeprefix("http://").partition(":")
    with socket.create_connection((host, int(port)), 5.0) as connection:
        head = f"POST /Evaluate HTTP/1.1\r\nHost: h\r\nContent-Length: {length}\r\n\r\n"
        connection.sendall(head.encode("latin-1"))
        assert b" 400 " in connection.recv(4096)


def asked(url: str, path: str, **body: Any) -> tuple[int, dict[str, Any]]:
    answer = httpx2.post(f"{url}/{path}", content=json.dumps(body), trust_env=False)
    return answer.status_code, answer.json()


def test_the_server_says_what_it_has(url: str) -> None:
    info = httpx2.get(f"{url}/Info", trust_env=False).json()
    assert info == {"protocolVersion": 1.0, "models": ["ishigami"]}
    assert asked(url, "InputSizes", name="ishigami") == (200, {"inputSizes": [3]})
    assert asked(url, "OutputSizes", name="ishigami", config={}) == (200, {"outputSizes": [1]})
    supports = asked(url, "ModelInfo", name="ishigami")[1]["support"]
    assert [feature for feature, there in supports.items() if there] == ["Evaluate"]


@pytest.mark.parametrize(
    ("path", "body", "status", "kind"),
    [
        ("Evaluate", {"name": "knee"}, 400, "ModelNotFound"),
        ("Evaluate", {"name": "ishigami", "input": [[1, 2]]}, 400, "InvalidInput"),
        ("Evaluate", {"name": "ishigami", "input": [[1, 2, "3"]]}, 400, "InvalidInput"),
        ("Evaluate", {"name": "ishigami", "input": [[1, 2, 1e999]]}, 400, "InvalidInput"),
        ("Evaluate", {"name": "ishigami", "input": [[3, 0, 0]]}, 500, "ModelFailure"),
        ("Gradient", {"name": "ishigami"}, 400, "UnsupportedFeature"),
        ("ApplyHessian", {}, 400, "UnsupportedFeature"),
        ("Nothing", {"name": "ishigami"}, 404, "UnsupportedFeature"),
    ],
)
def test_what_cannot_be_answered_is_an_error_of_the_protocol(
    url: str, path: str, body: dict[str, Any], status: int, kind: str
) -> None:
    code, answer = asked(url, path, **body)
    assert (code, answer["error"]["type"]) == (status, kind)
    assert answer["error"]["message"]
