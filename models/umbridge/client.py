"""Models of kind `umbridge`: a server elsewhere evaluates, a model's folder says what it maps."""

import json
import time
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any, TypeGuard

import httpx2

from models.description import complete
from models.evaluation import ModelAway, ModelFailure, columns
from models.folder import ModelError, ModelFolder

PROTOCOL = 1.0
#: Seconds for a question whose answer is no evaluation.
ASK_SECONDS = 30.0
#: ... for a connection, of an evaluation that may take hours.
CONNECT_SECONDS = 5.0
#: ... for one that only asks whether it is there again.
AWAY_SECONDS = 1.0
#: Characters of the names of a server's models that are shown.
MOST_NAMES = 500
#: Of an answer: what a program may print, too.
MAX_ANSWER_BYTES = 5_000_000
#: What says that nothing is there: a port that refuses, or a machine that is off.
_NO_CONNECTION = (httpx2.ConnectError, httpx2.ConnectTimeout)


class _TooLongError(ValueError):
    """An answer is longer than any."""


class ServerAwayError(ModelError):
    """Nothing answers where a server was."""


def check_address(url: str) -> None:
    """Raise a ModelError unless there can be a server at `url`."""
    try:
        address = httpx2.URL(url)
        is_one = address.scheme in ("http", "https") and bool(address.host)
    except (httpx2.InvalidURL, UnicodeError):
        is_one = False
    if not is_one:
        raise ModelError(
            "is no address of an UM-Bridge server: it begins with http:// or https://, and a host "
            "follows",
            file=f"--umbridge {url[:80]}",
        )


def answers(url: str) -> bool:
    """Say whether something at a server's URL takes a connection now."""
    try:
        httpx2.get(f"{url}/Info", timeout=AWAY_SECONDS, trust_env=False)
    except httpx2.HTTPError:
        return False
    return True


class Server:
    """A server that speaks UM-Bridge.

    Raises:
        ServerAwayError: nothing answers at `url`.
        ModelError: `url` is no address, there is no server, or it speaks another version.
    """

    def __init__(self, url: str) -> None:
        check_address(url)
        self.url = url.rstrip("/")
        # A server of models stands beside the worker; a proxy would not know it.
        self._http = httpx2.Client(timeout=ASK_SECONDS, trust_env=False)
        try:
            self.models = self._names()
        except ModelError:
            self.close()
            raise

    def _names(self) -> Sequence[str]:
        """Return the names of the server's models."""
        info = self._asked("GET", "Info")
        if "protocolVersion" not in info:
            raise self._wrong("is no UM-Bridge server: it tells no protocolVersion")
        if info["protocolVersion"] != PROTOCOL:
            raise self._wrong(f"speaks version {str(info['protocolVersion'])[:40]}, not {PROTOCOL}")
        models = info.get("models") or []
        if not isinstance(models, list) or not all(isinstance(name, str) for name in models):
            raise self._wrong("does not tell the names of its models")
        return models

    def evaluates(self, name: str) -> bool:
        """Say whether the model `name` can be evaluated."""
        support = self._asked("POST", "ModelInfo", {"name": name}).get("support")
        return isinstance(support, dict) and support.get("Evaluate") is True

    def sizes(self, name: str, config: Mapping[str, Any]) -> tuple[list[int], list[int]]:
        """Return how long the vectors are that the model `name` takes and gives."""
        asked = {"name": name, "config": config}
        inputs = self._asked("POST", "InputSizes", asked).get("inputSizes")
        outputs = self._asked("POST", "OutputSizes", asked).get("outputSizes")
        if not _are_sizes(inputs) or not _are_sizes(outputs):
            raise self._wrong(f"does not say how long the vectors of {name} are")
        return inputs, outputs

    def evaluate(
        self,
        name: str,
        vectors: Sequence[Sequence[float]],
        config: Mapping[str, Any],
        seconds: float | None,
    ) -> Any:
        """Return the vectors that the model `name` gives.

        Raises:
            ModelAway: the server takes no connection.
            ModelFailure: "timed_out"; "crashed": it broke off, or says that it failed.
        """
        asked = {"name": name, "input": vectors, "config": config}
        # Whoever waits for it as long as for an answer cannot tell a machine that is off.
        connect = CONNECT_SECONDS if seconds is None else min(CONNECT_SECONDS, 0.5 * seconds)
        patience = httpx2.Timeout(seconds, connect=connect)
        try:
            status, content = self._exchange("POST", "Evaluate", asked, patience, seconds)
            said = json.loads(content)
        except _NO_CONNECTION as error:
            raise ModelAway(f"{self.url}: {error}") from None
        except httpx2.TimeoutException:
            raise ModelFailure("timed_out", f"{self.url} gave no answer in time") from None
        except httpx2.HTTPError as error:
            raise ModelFailure("crashed", f"{self.url}: {error}") from None
        except _TooLongError as error:
            raise ModelFailure("bad_answer", f"{self.url}: {error}") from None
        except (ValueError, RecursionError):
            raise ModelFailure("bad_answer", f"{self.url} answered {status} without JSON") from None
        if not isinstance(said, dict) or "output" not in said or "error" in said:
            why = said.get("error", said) if isinstance(said, dict) else said
            message = why.get("message", why) if isinstance(why, dict) else why
            raise ModelFailure("crashed", f"{self.url}: {str(message)[:500]}")
        return said["output"]

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def _exchange(
        self,
        method: str,
        path: str,
        body: Any,
        patience: float | httpx2.Timeout,
        seconds: float | None,
    ) -> tuple[int, bytes]:
        """Return status and body of an answer that ends within `seconds` (None: some time).

        Raises:
            httpx2.TimeoutException: it dribbles on, each part within `patience`.
            _TooLongError: it is no answer any more, but a flood.
        """
        begun, content = time.monotonic(), b""
        url = f"{self.url}/{path}"
        with self._http.stream(method, url, json=body, timeout=patience) as answer:
            for part in answer.iter_bytes():
                content += part
                if len(content) > MAX_ANSWER_BYTES:
                    raise _TooLongError(f"it answered more than {MAX_ANSWER_BYTES // 10**6} MB")
                if seconds is not None and time.monotonic() - begun > seconds:
                    raise httpx2.ReadTimeout(f"it went on for more than {seconds:g} s")
        return answer.status_code, content

    def _asked(self, method: str, path: str, body: Any = None) -> dict[str, Any]:
        try:
            _, content = self._exchange(method, path, body, ASK_SECONDS, ASK_SECONDS)
            said = json.loads(content)
        except _NO_CONNECTION as error:
            raise ServerAwayError(f"no UM-Bridge server answers: {error}", file=self.url) from None
        except (httpx2.HTTPError, httpx2.InvalidURL, ValueError, RecursionError) as error:
            raise self._wrong(f"is no UM-Bridge server: {error}") from None
        if not isinstance(said, dict):
            raise self._wrong("is no UM-Bridge server")
        return said

    def _wrong(self, detail: str) -> ModelError:
        return ModelError(detail, file=self.url)


class RemoteModel:
    """A model of a server, whose vectors are our factors and outputs, one after another.

    Raises:
        ModelError: the server has no such model, or it has other sizes.
    """

    def __init__(self, folder: ModelFolder, server: Server) -> None:
        self._name = folder.run.get("name", folder.description.name)
        self._config = folder.run.get("config", {})
        self._description, self._server = folder.description, server
        if self._name not in server.models:
            named = ", ".join(server.models)[:MOST_NAMES]
            raise ModelError(f"umbridge.name is {self._name!r}, and {server.url} has {named}")
        if not server.evaluates(self._name):
            raise ModelError(f"{self._name} of {server.url} supports no evaluation")
        self._inputs, self._outputs = server.sizes(self._name, self._config)
        for part, here, there in (
            ("factors", len(self._description.factors), sum(self._inputs)),
            ("outputs", len(self._description.outputs), sum(self._outputs)),
        ):
            if here != there:
                raise ModelError(
                    f"{part} are {here} numbers, and {self._name} of {server.url} has {there}"
                )

    def __call__(self, parameters: Mapping[str, float], seed: int = 0) -> dict[str, float]:
        """Return the outputs at `parameters` (SI units; one left out is nominal).

        Raises:
            ValueError: a parameter is unknown or not finite.
            ModelFailure: "timed_out", "crashed", "bad_answer" or "not_finite".
            ModelAway: the server takes no connection.
        """
        values = iter(complete(self._description, parameters).values())
        asked = [list(islice(values, size)) for size in self._inputs]
        limit = self._description.time_limit
        answer = self._server.evaluate(self._name, asked, self._config, limit)
        vectors = answer if isinstance(answer, list) else []
        if [len(v) if isinstance(v, list) else -1 for v in vectors] != self._outputs:
            raise ModelFailure(
                "bad_answer", f"the output must be vectors of the lengths {self._outputs}"
            )
        numbers = iter([number for vector in vectors for number in vector])
        outputs: dict[str, Any] = {}
        for output in self._description.results:
            curve = output.curve
            outputs[output.name] = (
                next(numbers, None) if curve is None else list(islice(numbers, curve))
            )
        return columns(self._description, outputs)

    def close(self) -> None:
        """Close the connection to the server."""
        self._server.close()


def _are_sizes(said: Any) -> TypeGuard[list[int]]:
    return isinstance(said, list) and all(type(size) is int and size >= 0 for size in said)
