"""What a worker asks a coordinator: instances to compute, and that their results are taken."""

from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from rehyb.client.connection import Connection, Json, body_of, error_of, path_of


class Leases(Connection):
    """Workers, their leases and their results."""

    def workers(self) -> list[Json]:
        """Return every worker the coordinator has heard of."""
        workers: list[Json] = self._json("GET", "/v1/workers")["workers"]
        return workers

    def page_address(self) -> str:
        """Return an address of the coordinator's pages that signs a browser in, once."""
        made = self._json("POST", "/v1/sign-in-codes")
        return f"{self.url}{made['path']}"

    def health(self) -> Json:
        """Return {"status", "date"}: "ok" if the coordinator lives, and its clock (RFC 9110)."""
        response = self._request("GET", "/healthz")
        return {**body_of(response), "date": response.header("Date") or None}

    def lease(
        self,
        *,
        worker: Mapping[str, Any],
        models: Sequence[str],
        max_instances: int,
        at_most: Mapping[str, int] | None = None,
    ) -> Json | None:
        """Lease up to `max_instances` instances; None (and `retry_after` set) if there are none.

        Args:
            worker: {"id", "host", "versions", "tags"}.
            at_most: of some models fewer.

        Raises:
            Conflict: there is work, but none that this worker fits; the message says why.
        """
        body = {"worker": worker, "models": list(models), "max_instances": max_instances}
        if at_most:
            body["at_most"] = dict(at_most)
        return self._leased("/v1/leases", body)

    def renew(self, lease_id: str, fence: int) -> Json:
        """Keep a lease for another ttl; Conflict or NotFound if it is no longer this worker's."""
        return self._json("POST", path_of("leases", lease_id, "renew"), {"fence": fence})

    def release(self, lease_id: str, fence: int) -> None:
        """Give back what is unfinished of a lease."""
        self._request("POST", path_of("leases", lease_id, "release"), {"fence": fence})

    def post_results(
        self, *, lease: str, fence: int, worker: str, results: Sequence[Mapping[str, Any]]
    ) -> list[Json]:
        """Post results and return one verdict for each: {"instance", "verdict", "detail"}.

        Refused results do not raise: their verdict says so, and the others are taken.
        """
        body = {"lease": lease, "fence": fence, "worker": worker, "results": list(results)}
        verdicts: list[Json] = self._post_results(body)["verdicts"]
        return verdicts

    def exchange(
        self,
        *,
        lease: str,
        fence: int,
        worker: str,
        results: Sequence[Mapping[str, Any]],
        request: Mapping[str, Any],
    ) -> Json:
        """Post results and lease the next instances in one request.

        Args:
            request: {"worker", "models", "max_instances", "at_most"}, as for `lease`.

        Returns:
            {"verdicts", "next", "misfit"}: as `post_results` and `lease` return them, and why there
            is no next lease although there is work (None: there is a lease, or no work).
        """
        body = {"lease": lease, "fence": fence, "worker": worker, "results": list(results)}
        return self._post_results({**body, "next": dict(request)})

    def _post_results(self, body: Json) -> Json:
        response = self._send("POST", "/v1/results", body)
        if response.status_code not in (HTTPStatus.OK, HTTPStatus.CONFLICT):
            raise error_of(response)
        answer = body_of(response)
        if "verdicts" not in answer:
            raise error_of(response)
        self._note_pause(response)
        return answer
