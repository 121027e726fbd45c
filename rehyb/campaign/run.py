"""The paper's two-phase study: screen all factors, fix the least influential, rank the others.

What has been decided is kept in the campaign's directory before it is acted on, so an interrupted
campaign resumes where it was.
"""

import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from rehyb.campaign import decisions
from rehyb.campaign.decisions import Phase, Proposed
from rehyb.campaign.files import MANIFEST, Report, load_manifest, write_report
from rehyb.campaign.plans import Plan
from rehyb.client import Client, Json
from rehyb.errors import CampaignError, ServerError, Unreachable
from rehyb.whole_files import write_json

T = TypeVar("T")

POLL_SECONDS = 0.5


@dataclass(frozen=True, kw_only=True)
class View:
    """What there is to see of a campaign at one moment."""

    phase: int
    title: str
    output: str
    progress: Json
    snapshot: Json
    #: One sentence when something keeps the campaign waiting; else empty.
    waiting: str = ""


@dataclass
class Campaign:
    """One campaign in one directory.

    Raises:
        CampaignError: the directory holds a campaign with a different plan.
    """

    #: The coordinator, which must have workers and an analysis.
    client: Client
    plan: Plan
    #: Made if missing; holds the manifest and the results.
    directory: Path
    _: KW_ONLY
    #: Called with a View twice a second.
    show: Callable[[View], None]
    #: Called twice a second; an exception from it ends the campaign.
    tick: Callable[[], None]
    #: Called once with what phase 1 proposes; returns the factor to fix, or None to end there.
    confirm: Callable[[Proposed], str | None] = lambda proposed: proposed.factor
    sleep: Callable[[float], None] = time.sleep

    def __post_init__(self) -> None:
        self._view: View | None = None
        self._since = time.monotonic()
        self._manifest = load_manifest(self.directory, self.plan)

    def run(self) -> Report:
        """Run what is left of the campaign and write its files.

        Raises:
            CampaignError: a study was cancelled, or too few instances succeeded to rank anything.
            RehybError: the coordinator refuses a study.
        """
        try:
            phase1 = self._run_phase(decisions.screening_phase(self.plan))
            decision = self._decide(phase1["indices"])
            phase2 = self._run_phase(decisions.variance_phase(self.plan, decision["fixed"]))
            report = write_report(
                self.directory,
                self.plan,
                decision,
                (phase1, phase2),
                seconds=self._seconds,
                precision=self._manifest.get("precision"),
            )
            self._manifest |= {"failures": report.failures, "instances": report.instances}
            return report
        finally:
            self._save()

    def _run_phase(self, phase: Phase) -> Json:
        """Run one study to its end and return {"study", "progress", "indices"}."""
        begun = self._manifest["phases"][phase.number - 1]
        # Kept, because the coordinator takes a key again only with the very same study.
        begun["study"] = begun["study"] or phase.study
        self._save()
        study = self._ask(partial(self.client.submit, begun["study"], idempotency_key=begun["key"]))
        study_id = study["id"]
        done = False
        while not done:
            progress = self._ask(partial(self.client.progress, study_id))
            snapshot = self._ask(partial(self.client.indices, study_id))
            done, waiting = decisions.standing(progress, snapshot)
            step = (
                decisions.next_step(self.plan, phase, snapshot, progress["rows"]) if done else None
            )
            if step is not None:
                self._manifest["precision"] = step.sentence
                if step.rows is not None:
                    study = self._ask(partial(self.client.extend, study_id, step.rows))
                    done = False
            self._view = View(
                phase=phase.number,
                title=phase.title,
                output=self.plan.output,
                progress=progress,
                snapshot=snapshot,
                waiting=waiting,
            )
            self.show(self._view)
            if not done:
                self.sleep(POLL_SECONDS)
        found = {"study": study, "progress": progress, "indices": snapshot}
        write_json(self.directory / f"phase{phase.number}.json", found)
        table = self.directory / f"phase{phase.number}.csv"
        self._ask(partial(self.client.results_csv, study_id, table))
        return found

    def _ask(self, call: Callable[[], T]) -> T:
        """Make a call of the client; once the coordinator was there, wait for it to come back."""
        while True:
            self.tick()
            try:
                return call()
            except (Unreachable, ServerError) as error:
                if self._view is None:
                    raise
                self.show(replace(self._view, waiting=f"{error}; trying again"))
            self.sleep(POLL_SECONDS)

    def _decide(self, snapshot: Json) -> Json:
        """Choose the factor to fix, once; a resumed campaign keeps its choice."""
        if not self._manifest["decision"]:
            proposed = decisions.propose(self.plan, snapshot)
            if proposed is None:
                raise CampaignError(
                    f"phase 1 ranks nothing: too few instances gave {self.plan.output}; see "
                    f"{self.directory / 'phase1.csv'} for why, or ask for more rows"
                )
            agreed = self.confirm(proposed)
            if agreed is None:
                raise CampaignError(
                    f"nothing was fixed, and phase 2 waits; phase 1 is in {self.directory}. Run "
                    "the same command again to decide otherwise"
                )
            self._manifest["decision"] = decisions.decided(proposed, agreed)
            self._save()
        return dict(self._manifest["decision"])

    def _seconds(self) -> float:
        """Return the wall seconds of this session and of those before it."""
        now = time.monotonic()
        self._manifest["seconds"] += now - self._since
        self._since = now
        return float(self._manifest["seconds"])

    def _save(self) -> None:
        self._seconds()
        write_json(self.directory / MANIFEST, self._manifest)
