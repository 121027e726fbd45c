"""What a client can ask a coordinator about studies."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from rehyb.client.connection import Connection, Json, path_of
from rehyb.client.states import StudyState
from rehyb.errors import Conflict, Invalid, ServerError, Unreachable

#: How long the analysis may be behind a complete study: many times what it is
#: (docs/measurements/indices.md).
ANALYSIS_SECONDS = 10.0
#: How long who follows a study waits for a coordinator, or its database, that is restarted.
AWAY_SECONDS = 600.0
#: Between two looks at a study with a precision goal.
POLL_SECONDS = 1.0


class Studies(Connection):
    """Studies: submitted, followed, controlled, and their results."""

    def submit(self, study: Mapping[str, Any], idempotency_key: str | None = None) -> Json:
        """Submit a study and return it as the coordinator understood it.

        Args:
            study: name, model, method and rows; optionally factors, fixed, seed, outputs, sampling,
                precision (as `set_precision_goal` has it).
            idempotency_key: submitting again with the same key returns the study already there.

        Raises:
            Conflict: the key was used for a different study.
        """
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        return self._json("POST", "/v1/studies", study, headers)

    def studies(self) -> list[Json]:
        """Return every study in short, oldest first: `study` tells all of one."""
        found: list[Json] = []
        query = ""
        while True:
            answer = self._json("GET", f"/v1/studies{query}")
            found += answer["studies"]
            # An earlier coordinator gives all at once.
            if (after := answer.get("next")) is None:
                return found
            query = "?" + urlencode({"after": after})

    def work(self, group: str | None = None) -> Json:
        """Return {"waiting", "under_way"}: instances to hand out now, and those workers have.

        Args:
            group: whose workers (REHYB_WORKER_GROUP) would take them. Those that they may not have
                are counted as "unfit" instead, and "why" says why.
        """
        return self._json("GET", "/v1/work" + (f"?group={quote(group)}" if group else ""))

    def study(self, study_id: str) -> Json:
        """Return one study; NotFound if there is none."""
        return self._json("GET", path_of("studies", study_id))

    def progress(self, study_id: str) -> Json:
        """Return how far a study is: counts, failures by cause, rate and remaining time."""
        return self._json("GET", path_of("studies", study_id, "progress"))

    def indices(self, study_id: str) -> Json:
        """Return the latest snapshot of a study's sensitivity indices with their intervals."""
        return self._json("GET", path_of("studies", study_id, "indices"))

    def pause(self, study_id: str) -> Json:
        """Hand out nothing of a study until it is resumed; results under way are taken."""
        return self._json("POST", path_of("studies", study_id, "pause"))

    def drain(self, study_id: str) -> Json:
        """Finish the rows of a study that were begun and begin no other; then it is paused."""
        return self._json("POST", path_of("studies", study_id, "drain"))

    def resume(self, study_id: str) -> Json:
        """Go on with a paused or draining study; Conflict if it is complete or cancelled."""
        return self._json("POST", path_of("studies", study_id, "resume"))

    def extend(self, study_id: str, rows: int) -> Json:
        """Give a study `rows` rows in all; what is there stays. Conflict if it has more."""
        return self._json("POST", path_of("studies", study_id, "extend"), {"rows": rows})

    def set_precision_goal(
        self, study_id: str, up_to: int, target: float | None = None, output: str | None = None
    ) -> Json:
        """Have a study extended until it is precise enough, and return it.

        The coordinator's analysis does it, whenever the study is complete, without a client; the
        study's "precision" lists what was decided.

        Args:
            up_to: rows that it may have in all.
            target: half width of every interval; None: 0.02 of S and ST, a tenth of the
                largest mu*.
            output: whose indices; None: the study's first output.

        Raises:
            Invalid: it has no such output.
            Conflict: it is cancelled.
        """
        body = {"up_to": up_to, "target": target, "output": output}
        return self._json("POST", path_of("studies", study_id, "precision"), body)

    def remove_precision_goal(self, study_id: str) -> None:
        """Extend a study no more; the rows that it has are finished."""
        self._request("DELETE", path_of("studies", study_id, "precision"))

    def prioritise(self, study_id: str, priority: int) -> Json:
        """Serve a study before all of lower priority; 0 is where every study begins."""
        return self._json("POST", path_of("studies", study_id, "priority"), {"priority": priority})

    def rerun(
        self, study_id: str, which: str = "failed", outcomes: Sequence[str] | None = None
    ) -> Json:
        """Run results again and return the study with "taken_back", how many these are.

        Args:
            which: "failed", or "all": from the start, with whatever version workers have now.
            outcomes: only failures of these names.
        """
        body = {"which": which, "outcomes": None if outcomes is None else list(outcomes)}
        return self._json("POST", path_of("studies", study_id, "rerun"), body)

    def delete(self, study_id: str) -> None:
        """Remove a study with its results; Conflict while it runs."""
        self._request("DELETE", path_of("studies", study_id))

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
            state: "pending", "leased", "done", "ok", "failed" or "quarantined".
            after: `next` of the page before.
            limit: how many, 1000 at most.
        """
        query = {"state": state, "outcome": outcome, "after": after, "limit": limit}
        given = {name: value for name, value in query.items() if value is not None}
        return self._json("GET", path_of("studies", study_id, "instances") + f"?{urlencode(given)}")

    def instance(self, study_id: str, row: int, position: int) -> Json:
        """Return all that is needed to replay an instance, and its result."""
        return self._json("GET", path_of("studies", study_id, "instances", row, position))

    def cancel(self, study_id: str) -> Json:
        """Stop handing out a study's instances; results already there stay."""
        return self._json("POST", path_of("studies", study_id, "cancel"))

    def results_csv(self, study_id: str, path: Path | str) -> None:
        """Write a study's results to `path`; a download cut short leaves no file behind."""
        self._download(path_of("studies", study_id, "results.csv"), path)

    def all_instances(
        self,
        study_id: str,
        *,
        state: str | None = None,
        outcome: str | None = None,
        page: int = 1000,
    ) -> list[Json]:
        """Return the instances that `instances` lists, page after page."""
        found: list[Json] = []
        after: str | None = None
        while True:
            answer = self.instances(study_id, state=state, outcome=outcome, after=after, limit=page)
            found += answer["instances"]
            after = answer["next"]
            if after is None:
                return found

    def wait(
        self,
        study_id: str,
        *,
        poll_seconds: float = 1.0,
        on_progress: Callable[[Json], None] = lambda progress: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Json:
        """Block until a study is complete or cancelled and return its last progress.

        One that has a precision goal is complete when it is extended no more. Its indices are of
        all results then, unless no analysis follows them within `ANALYSIS_SECONDS` of `clock`.
        A coordinator that was there is waited for, `AWAY_SECONDS` at most.
        """
        progress = self.progress(study_id)
        while True:
            on_progress(progress)
            if _is_over(progress):
                break
            sleep(poll_seconds)
            progress = self._progress_again(study_id, clock, sleep)
        deadline = clock() + ANALYSIS_SECONDS
        while progress["state"] == StudyState.COMPLETE and clock() < deadline:
            if self.indices(study_id)["rows_complete"] >= progress["rows"]:
                break
            sleep(min(poll_seconds, 0.2))
        return progress

    def wait_for_precision(
        self,
        study_id: str,
        *,
        on_progress: Callable[[Json], None] = lambda progress: None,
        on_step: Callable[[str], None] = lambda sentence: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Json:
        """Wait until a study with a precision goal is extended no more.

        It only looks: interrupted, the study goes on, and the same call can follow it again. A
        coordinator that was there is waited for, as `wait` does.

        Args:
            on_progress: called about once a second.
            on_step: called with the sentence of every decision, those of before included.

        Returns:
            The study's "precision" as it is at the end, with "rows".

        Raises:
            Conflict: the study was cancelled.
            Invalid: it has no goal.
        """
        known = 0
        progress = self.progress(study_id)
        while True:
            on_progress(progress)
            goal = progress["precision"]
            if goal is None:
                raise Invalid(f"study {study_id} has no precision to reach: say one with --up-to")
            # A goal that was set anew begins anew.
            known = min(known, len(goal["steps"]))
            for step in goal["steps"][known:]:
                on_step(step["sentence"])
                known += 1
            if progress["state"] == StudyState.CANCELLED:
                raise Conflict(f"study {study_id} was cancelled before it was precise enough")
            if goal["settled"]:
                return {**goal, "rows": progress["rows"]}
            sleep(POLL_SECONDS)
            progress = self._progress_again(study_id, time.monotonic, sleep)

    def _progress_again(
        self, study_id: str, clock: Callable[[], float], sleep: Callable[[float], None]
    ) -> Json:
        """Return a study's progress from a coordinator that may be away for a while."""
        until = clock() + AWAY_SECONDS
        while True:
            try:
                return self.progress(study_id)
            except (Unreachable, ServerError):
                if clock() >= until:
                    raise
            sleep(POLL_SECONDS)


def _is_over(progress: Json) -> bool:
    """Say whether a study gets no further results; an older coordinator knows no precision."""
    goal = progress.get("precision")
    if progress["state"] in (StudyState.RUNNING, StudyState.DRAINING, StudyState.PAUSED):
        return False
    return goal is None or bool(goal["settled"])
