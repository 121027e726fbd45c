"""What a worker brings and asks for in one request, and what it is told."""

import re

from sqlalchemy.engine import Connection

from server.logic.fleet.verdicts import Judgement
from server.operations.fleet import leasing, results
from server.operations.fleet.leasing import Deferred, Grant, Ineligible, LeaseRequest
from server.operations.fleet.results import Post
from server.records import record

#: What a worker is told: a judgement of each result, and its next lease or why there is none.
Answer = tuple[list[Judgement], Grant | Ineligible | Deferred | None]


_STUDY = re.compile(r"[0-9a-f]{1,32}")


@record
class Exchange:
    """Results that a worker posts, its request for the next lease, or both."""

    now: float
    ttl: float
    posted: Post | None = None
    request: LeaseRequest | None = None

    @property
    def study(self) -> str:
        """Id of the study that its results are about, as they say; empty if it brings none."""
        if self.posted is None:
            return ""
        named = self.posted.reports[0].instance.partition(":")[0]
        # Anybody may call an instance anything.
        return named if _STUDY.fullmatch(named) else ""

    @property
    def size(self) -> int:
        """How many instances it is about."""
        brought = 0 if self.posted is None else len(self.posted.reports)
        return brought + (0 if self.request is None else self.request.max_instances)

    def alone(self, connection: Connection) -> Answer:
        """Deal with it in a transaction of its own."""
        now, ttl = self.now, self.ttl
        if self.posted is None:
            assert self.request is not None
            return [], leasing.grant(connection, self.request, now=now, ttl=ttl)
        if self.request is None:
            return results.take(connection, self.posted, now=now, ttl=ttl), None
        return results.exchange(connection, self.posted, self.request, now=now, ttl=ttl)
