"""Bring results from the spool to the coordinator, past those that it cannot take."""

import logging
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from rehyb.client import Client
from rehyb.errors import Invalid, ServerError
from worker.leases import LeaseRequest, Leases
from worker.spool import Batch, Spool

log = logging.getLogger(__name__)

#: Results at which the coordinator itself fails are posted so often before they are set aside:
#: others must get through.
TRIES = 5
#: Seconds after which what was set aside is posted again; the next worker that starts does so too.
ASIDE_SECONDS = 600.0
#: Verdicts of the coordinator with which a result is where it belongs.
TAKEN = ("accepted", "duplicate")


@dataclass(kw_only=True)
class Posting:
    """Posts what is in one spool, and leases the next instances in the same request."""

    client: Client
    spool: Spool
    leases: Leases
    #: How often the coordinator has failed at a batch, by the first of its keys.
    _tries: Counter[int] = field(default_factory=Counter)
    _bring_back_at: float = 0.0

    def bring_back(self, now: float) -> None:
        """Have what was set aside long enough ago posted again."""
        if now >= self._bring_back_at and (waiting := self.spool.bring_back()):
            log.info("trying again to post %d results that were set aside", waiting)

    def post(
        self, batch: Batch, request: LeaseRequest | None = None, *, hopeless: bool = False
    ) -> None:
        """Post a batch, and lease what `request` asks for.

        Args:
            request: None: ask for no work.
            hopeless: the batch is one result of several at which the coordinator has failed too
                often.

        Raises:
            ServerError: the coordinator fails; the batch stays in the spool.
            RehybError: it does not answer, or refuses the token; the same.
        """
        # However long the answer takes: the lease lasts from a moment after this one.
        now = time.monotonic()
        try:
            answer = self._send(batch, request)
        except Invalid as error:
            if request is not None:
                # An older coordinator leases nothing with results.
                self.post(batch)
            elif not self._post_one_by_one(batch, hopeless=False):
                log.error("the coordinator cannot use a result: %s: %s", error, batch.results[0])
                self.spool.acknowledge(batch.keys)
            return
        except ServerError as error:
            if not error.is_at_request:
                # It has had enough, or something before it has; what is posted has no part in it.
                raise
            self._tries[batch.keys[0]] += 1
            if not hopeless and self._tries[batch.keys[0]] < TRIES:
                raise
            del self._tries[batch.keys[0]]
            if not self._post_one_by_one(batch, hopeless=True):
                self._set_aside(batch, error)
            return
        self._tries.pop(batch.keys[0], None)
        # Whatever the verdict, it is final: posting the same result again would not change it.
        self.spool.acknowledge(batch.keys)
        _tell_refused(answer["verdicts"])
        self.leases.extend(batch.lease, now)
        if request is not None:
            self.leases.take(answer.get("next"), answer.get("misfit"), now)

    def _send(self, batch: Batch, request: LeaseRequest | None) -> Mapping[str, Any]:
        posted: dict[str, Any] = {
            "lease": batch.lease,
            "fence": batch.fence,
            "worker": batch.worker,
            "results": batch.results,
        }
        if request is None:
            return {"verdicts": self.client.post_results(**posted)}
        return self.client.exchange(**posted, request=request)

    def _post_one_by_one(self, batch: Batch, *, hopeless: bool) -> bool:
        """Post each result by itself, where one spoils the request for the others."""
        if len(batch.results) == 1:
            return False
        for key, result in zip(batch.keys, batch.results, strict=True):
            self.post(replace(batch, keys=(key,), results=(result,)), hopeless=hopeless)
        return True

    def _set_aside(self, batch: Batch, error: ServerError) -> None:
        log.error(
            "the coordinator fails at the result of %s, which stays on disk: it is posted "
            "again in %g minutes, and by the next worker on this machine (%s)",
            batch.results[0]["instance"],
            ASIDE_SECONDS / 60.0,
            error,
        )
        self.spool.set_aside(batch.keys)
        self._bring_back_at = time.monotonic() + ASIDE_SECONDS


def _tell_refused(verdicts: Sequence[Mapping[str, Any]]) -> None:
    """Say which results are not taken, those that are not for the same reason together."""
    refused: dict[tuple[str, Any], list[str]] = {}
    for one in verdicts:
        if one["verdict"] not in TAKEN:
            refused.setdefault((one["verdict"], one.get("detail")), []).append(one["instance"])
    for (verdict, detail), (first, *more) in refused.items():
        others = f" and of {len(more)} more" if more else ""
        log.warning(
            "the result of instance %s%s is not taken: %s: %s", first, others, verdict, detail
        )
