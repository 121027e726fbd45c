"""What a worker brings and asks for in one request, and what it is told."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

from server.logic.fleet.hosts import host_class
from server.logic.fleet.verdicts import Judgement, Report
from server.logic.study.points import told
from server.records import Introduction, Lease, Study, record

_STUDY = re.compile(r"[0-9a-f]{1,32}")


@record
class Post:
    """Results as a worker posts them, and what they are judged by."""

    reports: Sequence[Report]
    #: The lease it says they belong to, and the lease's fence to prove it.
    lease: str
    fence: int
    worker: str
    #: Of the results, how many another host computes again.
    share: float = 0.0
    #: Relative difference of an output at which two hosts still agree.
    tolerance: float = 0.0


@record
class LeaseRequest:
    """Who asks for instances, and for which."""

    worker: Introduction
    models: Sequence[str]
    max_instances: int
    #: Of some models fewer.
    at_most: Mapping[str, int] = field(default_factory=dict)

    def most(self, model: str) -> int:
        """How many instances of a model are wanted at once."""
        return min(self.max_instances, self.at_most.get(model, self.max_instances))

    def host_class(self, model: str = "") -> str:
        """The host class of who asks, as far as it matters to a model, "name@digest"."""
        return host_class(self.worker.versions, self.worker.models.get(model, ""))


@record
class Exchange:
    """Results that a worker posts, its request for the next lease, or both."""

    now: float
    ttl: float
    posted: Post | None = None
    request: LeaseRequest | None = None
    #: Id of the study in whose turn it is to be served, and of those that have nothing for it.
    first: str = ""
    passed: frozenset[str] = frozenset()

    @property
    def study(self) -> str:
        """Id of the study that it is about, as far as can be told without looking, or empty."""
        if self.first or self.posted is None:
            return self.first
        named = self.posted.reports[0].instance.partition(":")[0]
        # Anybody may call an instance anything.
        return named if _STUDY.fullmatch(named) else ""

    @property
    def size(self) -> int:
        """How many instances it is about."""
        brought = 0 if self.posted is None else len(self.posted.reports)
        return brought + (0 if self.request is None else self.request.max_instances)


@record
class Grant:
    """A new lease and the study its instances belong to."""

    lease: Lease
    study: Study
    _told: list[dict[str, Any]] = field(default_factory=list)

    def instances(self) -> list[dict[str, Any]]:
        """Return the instances as the worker is told of them; they are made once."""
        if not self._told:
            self._told.extend(told(self.study, self.lease.instances))
        return self._told


@record
class Ineligible:
    """There is work, but none that the worker may have."""

    why: str


@record
class Deferred:
    """The rest of an exchange, which is to be served in the turn of another study."""

    rest: Exchange


#: What a worker is told: a judgement of each result, and its next lease or why there is none.
Answer = tuple[list[Judgement], Grant | Ineligible | None]
#: The same of one turn.
Served = tuple[list[Judgement], Grant | Ineligible | Deferred | None]
