"""Talk to a coordinator: plain dictionaries in, plain dictionaries out."""

import time
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import httpx2

from rehyb.client.connection import DEFAULT_URL as DEFAULT_URL
from rehyb.client.connection import Json as Json
from rehyb.client.connection import body_of, error_of
from rehyb.client.sessions import Sessions

#: How long the analysis may be behind a complete study: many times what it is
#: (docs/measurements/analysis_speed.md).
ANALYSIS_SECONDS = 10.0


class Client(Sessions):
    """A connection to one coordinator.

    Args:
        url: where the coordinator listens; default REHYB_URL, else http://127.0.0.1:8787.
        token: the coordinator's token; default REHYB_TOKEN.
        timeout: seconds to wait for one answer.
        transport: for tests: what carries the requests instead of the network.

    Every method raises Unreachable when nothing answers, Unauthorized when the token is refused,
    Invalid when the coordinator cannot use the request, and ServerError when the coordinator fails.

    Raises:
        Unauthorized: there is no token.
    """

    # Studies

    def submit(self, study: Mapping[str, Any], idempotency_key: str | None = None) -> Json:
        """Submit a study and return it as the coordinator understood it.

        Args:
            study: name, model, method and rows; optionally factors, fixed, seed, outputs, sampling,
                precision (as `aim` has it).
            idempotency_key: submitting again with the same key returns the study already there.

        Raises:
            Conflict: the key was used for a different study.
        """
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        return self._json("POST", "/v1/studies", body=study, headers=headers)

    def studies(self) -> list[Json]:
        """Return every study."""
        studies: list[Json] = self._json("GET", "/v1/studies")["studies"]
        return studies

    def study(self, study_id: str) -> Json:
        """Return one study; NotFound if there is none."""
        return self._json("GET", f"/v1/studies/{study_id}")

    def progress(self, study_id: str) -> Json:
        """Return how far a study is: counts, failures by cause, rate and remaining time."""
        return self._json("GET", f"/v1/studies/{study_id}/progress")

    def indices(self, study_id: str) -> Json:
        """Return the latest snapshot of a study's sensitivity indices with their intervals."""
        return self._json("GET", f"/v1/studies/{study_id}/indices")

    def pause(self, study_id: str) -> Json:
        """Hand out nothing of a study until it is resumed; results under way are taken."""
        return self._json("POST", f"/v1/studies/{study_id}/pause")

    def drain(self, study_id: str) -> Json:
        """Finish the rows of a study that were begun and begin no other; then it is paused."""
        return self._json("POST", f"/v1/studies/{study_id}/drain")

    def resume(self, study_id: str) -> Json:
        """Go on with a paused or draining study; Conflict if it is complete or cancelled."""
        return self._json("POST", f"/v1/studies/{study_id}/resume")

    def extend(self, study_id: str, rows: int) -> Json:
        """Give a study `rows` rows in all; what is there stays. Conflict if it has more."""
        return self._json("POST", f"/v1/studies/{study_id}/extend", body={"rows": rows})

    def aim(
        self, study_id: str, up_to: int, target: float | None = None, output: str | None = None
    ) -> Json:
        """Have a study extended until it is precise enough, and return it.

        The coordinator's analysis does it, whenever the study is complete, without a client; the
        study's "precision" tells what was decided.

        Args:
            study_id: which study.
            up_to: rows that it may have in all.
            target: half width of every interval; None: 0.02 of S and ST, a tenth of the
                largest mu*.
            output: whose indices; None: the study's first output.

        Raises:
            Invalid: it has no such output.
            Conflict: it is cancelled.
        """
        body = {"up_to": up_to, "target": target, "output": output}
        return self._json("POST", f"/v1/studies/{study_id}/precision", body=body)

    def let_be(self, study_id: str) -> None:
        """Have a study extended no more; the rows that it has are finished."""
        self._request("DELETE", f"/v1/studies/{study_id}/precision")

    def prioritise(self, study_id: str, priority: int) -> Json:
        """Serve a study before all of lower priority; 0 is where every study begins."""
        return self._json("POST", f"/v1/studies/{study_id}/priority", body={"priority": priority})

    def rerun(
        self, study_id: str, which: str = "failed", outcomes: Sequence[str] | None = None
    ) -> Json:
        """Run results again and return the study with "taken_back", how many these are.

        Args:
            study_id: which study.
            which: "failed", or "all": from the start, with whatever version workers have now.
            outcomes: only failures of these names.
        """
        body = {"which": which, "outcomes": None if outcomes is None else list(outcomes)}
        return self._json("POST", f"/v1/studies/{study_id}/rerun", body=body)

    def delete(self, study_id: str) -> None:
        """Remove a study with its results; Conflict while it runs."""
        self._request("DELETE", f"/v1/studies/{study_id}")

    def instances(
        self,
        study_id: str,
        *,
        state: str | None = None,
        outcome: str | None = None,
        after: str | None = None,
        limit: int = 100,
    ) -> Json:
        """Return a page {"instances", "next"} of the instances in rows begun so far.

        Args:
            study_id: which study.
            state: "pending", "leased", "done", "ok", "failed" or "quarantined".
            outcome: only those with this outcome.
            after: `next` of the page before.
            limit: how many, 1000 at most.
        """
        query = {"state": state, "outcome": outcome, "after": after, "limit": limit}
        given = {name: value for name, value in query.items() if value is not None}
        return self._json("GET", f"/v1/studies/{study_id}/instances?{urlencode(given)}")

    def instance(self, study_id: str, row: int, position: int) -> Json:
        """Return all that is needed to replay an instance, and what became of it."""
        return self._json("GET", f"/v1/studies/{study_id}/instances/{row}/{position}")

    def cancel(self, study_id: str) -> Json:
        """Stop handing out a study's instances; results already there stay."""
        return self._json("POST", f"/v1/studies/{study_id}/cancel")

    def results_csv(self, study_id: str, path: Path) -> None:
        """Write a study's results to `path`; a download cut short leaves no file behind."""
        self._download(f"/v1/studies/{study_id}/results.csv", path)

    def wait(
        self,
        study_id: str,
        *,
        poll_seconds: float = 1.0,
        on_progress: Callable[[Json], None] = lambda progress: None,
    ) -> Json:
        """Block until a study is complete or cancelled and return its last progress.

        One that has a wanted precision is complete when it is extended no more. Its indices are of
        all results then, unless no analysis follows them within `ANALYSIS_SECONDS`.
        """
        while True:
            progress = self.progress(study_id)
            on_progress(progress)
            if _is_over(progress):
                break
            time.sleep(poll_seconds)
        patience = time.monotonic() + ANALYSIS_SECONDS
        while progress["state"] == "complete" and time.monotonic() < patience:
            if self.indices(study_id)["rows_complete"] >= progress["rows"]:
                break
            time.sleep(min(poll_seconds, 0.2))
        return progress

    # Workers

    def workers(self) -> list[Json]:
        """Return every worker the coordinator has heard of."""
        workers: list[Json] = self._json("GET", "/v1/workers")["workers"]
        return workers

    def health(self) -> Json:
        """Return {"status", "date"}: "ok" if the coordinator lives, and its clock (RFC 9110)."""
        response = self._request("GET", "/healthz")
        return {**body_of(response), "date": response.headers.get("Date")}

    def lease(
        self, *, worker: Mapping[str, Any], models: Sequence[str], max_instances: int
    ) -> Json | None:
        """Lease up to `max_instances` instances; None (and `retry_after` set) if there are none.

        Args:
            worker: {"id", "host", "versions", "tags"}.
            models: the models this worker can evaluate.

        Raises:
            Conflict: there is work, but none that this worker fits; the message says why.
        """
        body = {"worker": worker, "models": list(models), "max_instances": max_instances}
        response = self._request("POST", "/v1/leases", body=body)
        if response.status_code == HTTPStatus.NO_CONTENT:
            self._note_pause(response)
            return None
        return body_of(response)

    def renew(self, lease_id: str, fence: int) -> Json:
        """Keep a lease for another ttl; Conflict or NotFound if it is no longer this worker's."""
        return self._json("POST", f"/v1/leases/{lease_id}/renew", body={"fence": fence})

    def release(self, lease_id: str, fence: int) -> None:
        """Give back what is unfinished of a lease."""
        self._request("POST", f"/v1/leases/{lease_id}/release", body={"fence": fence})

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
            lease: the lease that the results belong to.
            fence: the lease's.
            worker: who computed them.
            results: as for `post_results`.
            request: {"worker", "models", "max_instances"}, as for `lease`.

        Returns:
            {"verdicts", "next", "misfit"}: as `post_results` and `lease` return them, and why there
            is no next lease although there is work (None: there is a lease, or no work).
        """
        body = {"lease": lease, "fence": fence, "worker": worker, "results": list(results)}
        return self._post_results({**body, "next": dict(request)})

    def _post_results(self, body: Json) -> Json:
        response = self._send("POST", "/v1/results", body=body)
        if response.status_code not in (HTTPStatus.OK, HTTPStatus.CONFLICT):
            raise error_of(response)
        answer = body_of(response)
        if "verdicts" not in answer:
            raise error_of(response)
        self._note_pause(response)
        return answer

    def _note_pause(self, response: httpx2.Response) -> None:
        seconds = response.headers.get("Retry-After", "")
        self.retry_after = float(seconds) if seconds.isdigit() else 1.0


def _is_over(progress: Json) -> bool:
    """Say whether nothing more will come of a study; a coordinator of before has no precision."""
    goal = progress.get("precision")
    if progress["state"] in ("running", "draining", "paused"):
        return False
    return goal is None or bool(goal["settled"])
