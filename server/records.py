"""What is stored, noun by noun: plain records that decisions and SQL both know.

Times are seconds, UTC epoch.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from analysis.designs import row_width
from analysis.designs.dependence import Dependence, copula
from analysis.designs.distributions import Distribution
from analysis.designs.groups import units_of
from analysis.sensitivity.judgement.stopping import Goal
from models.curves import Curve
from models.description import Description
from server.states import (
    CloseLoopState,
    ComparisonState,
    InstanceState,
    JobKind,
    Outcome,
    StudyState,
)

T = TypeVar("T")

#: (row, position) of an instance in its study.
Place = tuple[int, int]


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(field,))
def record(kind: type[T]) -> type[T]:
    """Make a class a dataclass of which one request of a worker makes dozens.

    The type checker lets nobody change it; to freeze it at run time as well would triple the time
    that making one takes.
    """
    return dataclass(kw_only=True, slots=True)(kind)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything that decides which points a study evaluates: its manifest."""

    name: str
    model: str
    method: str
    sampling: str
    rows: int
    seed: int
    #: Sampled factors, in the model's order.
    distributions: Mapping[str, Distribution]
    #: Every other factor of the model, with the value it keeps (SI units).
    fixed: Mapping[str, float]
    #: Outputs kept, in the model's order; of a curve, every point.
    outputs: tuple[str, ...]
    #: Factors that move together, by the name of their group.
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Those that are curves, by name.
    curves: Mapping[str, Curve] = field(default_factory=dict)
    #: How the factors depend on each other; None: not at all.
    dependence: Dependence | None = None

    @cached_property
    def correlation(self) -> NDArray[np.float64] | None:
        """Of the normals behind the factors (`analysis.designs.dependence.copula`), or None."""
        if self.dependence is None:
            return None
        return copula(
            self.dependence, tuple(self.distributions), tuple(self.distributions.values())
        )

    @cached_property
    def width(self) -> int:
        """Instances in one row of the design."""
        return row_width(self.method, len(units_of(self.distributions, self.groups)))

    @cached_property
    def instances(self) -> int:
        """Instances in the whole study."""
        return self.rows * self.width


@record
class Study:
    """A plan and how far it has come."""

    id: str
    plan: Plan
    state: StudyState
    created_at: float
    #: When the study was completed or cancelled; None while it runs.
    finished_at: float | None = None
    #: Instances of the rows begun, which are the first ones: each row is begun as a whole.
    handed_out: int = 0
    #: Instances a worker holds now.
    leased: int = 0
    #: Final results, which are numbered 1, 2, ... in the order they came.
    result_count: int = 0
    ok_count: int = 0
    #: Rows in which every position has a final result.
    rows_complete: int = 0
    #: Final failures by outcome.
    failures: Mapping[str, int] = field(default_factory=dict)
    #: Of two studies with work, the one with the higher priority is served.
    priority: int = 0
    #: What a worker must call itself to be given any of it.
    tags: tuple[str, ...] = ()
    #: The code of who got the first lease (`server.logic.fleet.hosts.identity`), see `bound_to`.
    identity: Mapping[str, str] | None = None
    #: Grows with every change that makes earlier readings of its log or its size obsolete.
    edition: int = 0

    @property
    def bound_to(self) -> Mapping[str, str] | None:
        """The code that it belongs to; None: nobody has computed any of it, or holds any."""
        computed = self.result_count - self.failures.get(Outcome.LOST, 0)
        return self.identity if computed or self.leased else None

    @property
    def pending(self) -> int:
        """Instances without a final result that nobody holds."""
        return self.plan.instances - self.result_count - self.leased

    @property
    def returned(self) -> int:
        """Instances of begun rows that nobody holds and that have no final result."""
        return self.handed_out - self.result_count - self.leased


@record
class Instance:
    """Where one instance of a begun row stands."""

    row: int
    position: int
    state: InstanceState
    #: The lease that holds it; None unless leased.
    lease: str | None
    #: How often it came back, by cause.
    attempts: Mapping[str, int]
    #: The kind of machine its row is computed on; None while any may take it.
    host_class: str | None = None
    #: The host on which it last went wrong: another one tries next, if there is one.
    avoid: str | None = None
    #: The hosts from which it came back, by cause, each once.
    hosts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def tried(self) -> set[str]:
        """The hosts on which it went wrong, for whatever cause."""
        return {host for hosts in self.hosts.values() for host in hosts}


@record
class Result:
    """The final result of one instance."""

    row: int
    position: int
    #: A `server.states.Outcome`, or the name of a failure that the model gives.
    outcome: str
    #: The study's outputs; None unless `outcome` is "ok".
    outputs: Mapping[str, float] | None
    reason: str
    state: Mapping[str, Any] | None
    wall_seconds: float | None

    def same_as(self, other: "Result") -> bool:
        """Say whether both report the same; how long it took and in which words does not count."""
        return self.outcome == other.outcome and self.outputs == other.outputs


@record
class Lease:
    """The right of one worker to evaluate some instances of one study until a moment."""

    id: str
    #: Grows with every lease granted; a worker must show it along with the id.
    fence: int
    worker: str
    study: str
    #: A `LeaseState`; of a close-loop job's lease also how its attempt ended.
    state: str
    expires_at: float
    #: Every instance handed out with it.
    instances: tuple[Place, ...]
    #: The kind of machine its worker was when it was granted.
    host_class: str | None = None
    #: Where its worker ran when it last asked for work.
    host: str = ""
    #: Whether it asks for second opinions on results that are there already.
    compares: bool = False


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A second opinion that is asked for, and what came of it."""

    id: int
    row: int
    position: int
    state: ComparisonState
    #: How often it failed to come.
    attempts: int
    #: What holds it; it stays when the second opinion has come.
    lease_id: str | None
    #: Whose result is computed again.
    first_host: str
    decided_at: float | None
    second_host: str | None
    second_worker_id: str | None
    #: The second host's.
    outcome: str | None
    outputs: Mapping[str, float] | None
    #: Largest relative difference of an output; None if the outcomes differ.
    difference: float | None


@dataclass(frozen=True, kw_only=True)
class Introduction:
    """What a worker that asks for work says of itself."""

    id: str
    host: str
    #: What decides whether two machines compute the same bits.
    versions: Mapping[str, str]
    #: What it says it is good for.
    tags: Sequence[str] = ()
    #: The models that it can evaluate besides rehyb's own, as "name@digest", each with its canary;
    #: and rehyb's own, by name and as "name@digest", if it has not all that the coordinator has.
    models: Mapping[str, str] = field(default_factory=dict)
    #: Models that it has or should have and does not evaluate, as "name@digest", and why.
    refused: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Worker(Introduction):
    """A process that evaluates instances, as it last introduced itself."""

    last_seen: float
    #: Instances whose final result it reported.
    instances_done: int
    #: Machines of one class compute the same bits; None if it last asked before there were any.
    host_class: str | None


@dataclass(frozen=True, kw_only=True)
class ModelVersion:
    """A model as it was announced or uploaded."""

    #: "name@digest": a study that samples it keeps this.
    version: str
    name: str
    description: Description
    #: Whether it comes with rehyb; a study then keeps its name alone.
    own: bool
    #: Who announced it last; empty for one that was uploaded or is our own.
    announced_by: str
    #: When it was last announced: the latest of a name is what a study means that names no digest.
    announced_at: float
    #: Bytes of its zip file; 0 if its code is with workers.
    size: int

    @property
    def called(self) -> str:
        """What a study and a worker call it."""
        return self.name if self.own else self.version


@dataclass(frozen=True, kw_only=True)
class PrecisionGoal(Goal):
    """How precise a study shall become, what that may cost, and what was done for it."""

    #: Edition of the study (`Study.edition`) at which nothing was left to do; None before.
    judged: int | None = None
    #: Every decision: "rows" that the study had, "extended_to" or None, "reached", "sentence".
    steps: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Session:
    """A measured session that passed the check."""

    id: str
    name: str
    #: Of its zip file, hexadecimal.
    sha256: str
    #: Bytes of its zip file.
    size: int
    #: What was understood of it: see `analysis.closeloop.check`.
    content: Mapping[str, Any]
    created_at: float


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One lease of a job on a session."""

    lease: str
    fence: int
    worker: str
    host: str
    granted_at: float
    #: How it ended: "done", "late" (another was faster) or an `Outcome`; None while it lasts.
    ended: str | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class CloseLoopJob:
    """Closing the loop on one session, or interpreting it, once."""

    id: str
    session_id: str
    state: CloseLoopState
    created_at: float
    finished_at: float | None = None
    #: When its lease ends; None unless running.
    expires_at: float | None = None
    #: How often it was handed out: the fence of its last lease.
    grants: int = 0
    attempts: tuple[Attempt, ...] = ()
    #: What its worker last said it is at.
    progress: str = ""
    #: Digest of the code that the report comes from.
    code: str | None = None
    #: Why it failed: {"outcome", "detail", "file", "column", "line"}.
    fault: Mapping[str, Any] | None = None
    verdict: str | None = None
    kind: JobKind = JobKind.CLOSE_LOOP
    #: Of an interpretation: {"known", "tolerance", "bank"}.
    options: Mapping[str, Any] | None = None

    @property
    def current(self) -> Attempt | None:
        """The attempt that is under way; None unless running."""
        return self.attempts[-1] if self.state == CloseLoopState.RUNNING else None

    @property
    def avoid(self) -> str | None:
        """The host on which it last went wrong: another one tries next, if there is one."""
        waits = self.state == CloseLoopState.WAITING and self.attempts
        return self.attempts[-1].host if waits else None


@dataclass(frozen=True, kw_only=True)
class Token:
    """The right to some requests."""

    id: str
    name: str
    scopes: tuple[str, ...]
    created_at: float
    #: None while it is good.
    revoked_at: float | None
