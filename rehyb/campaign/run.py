"""The paper's two-phase study: screen all factors, fix the least influential, rank the others.

Phase 1 is the elementary effects test of section 3.1 and phase 2 the variance-based analysis of
section 3.2. What has been decided is kept in the campaign's directory before it is acted on, so an
interrupted campaign resumes where it was.
"""

import json
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rehyb.campaign.plans import LATER, Plan
from rehyb.client import Client, Json
from rehyb.client.precision import decide
from rehyb.errors import CampaignError, ServerError, Unreachable

T = TypeVar("T")

POLL_SECONDS = 0.5
MANIFEST = "campaign.json"
#: The folder of every figure of the page as PNG.
FIGURES = "figures"


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


@dataclass(frozen=True, kw_only=True)
class Proposed:
    """What phase 1 proposes to fix, for somebody to agree to or not."""

    factor: str
    #: The value it would keep, with its unit.
    value: str
    #: One or two sentences with the numbers.
    evidence: str
    #: Every factor that may be fixed instead, the least influential first.
    factors: tuple[str, ...]
    snapshot: Json


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a campaign found, and where it is written."""

    plan: Plan
    fixed: str
    fixed_at: float
    #: Whether the interval separates the fixed factor from the influential ones.
    separated: bool
    evidence: str
    phase1: Json
    phase2: Json
    failures: Mapping[str, int]
    instances: int
    #: Wall time that the campaign has run, over all its sessions.
    seconds: float
    files: tuple[Path, ...]

    def to_json(self) -> Json:
        """Return the report as plain JSON, paths as strings."""
        return asdict(self) | {"files": [str(path) for path in self.files]}


class Campaign:
    """One campaign in one directory.

    Args:
        client: the coordinator, which must have workers and an analysis.
        plan: what to compute.
        directory: made if missing; holds the manifest and the results.
        show: called with a View twice a second.
        tick: called twice a second; an exception from it ends the campaign.
        confirm: called once with what phase 1 proposes; returns the factor to fix, or None to end
            the campaign there. Default: what is proposed is fixed.

    Raises:
        CampaignError: the directory holds a campaign with a different plan.
    """

    def __init__(
        self,
        client: Client,
        plan: Plan,
        directory: Path,
        *,
        show: Callable[[View], None],
        tick: Callable[[], None],
        confirm: Callable[["Proposed"], str | None] = lambda proposed: proposed.factor,
    ) -> None:
        self._client = client
        self._plan = plan
        self._directory = directory
        self._show = show
        self._tick = tick
        self._confirm = confirm
        self._view: View | None = None
        self._since = time.monotonic()
        self._manifest = _manifest(directory, plan)

    def run(self) -> Report:
        """Run what is left of the campaign and write its files.

        Raises:
            CampaignError: a study was cancelled, or too few instances succeeded to rank anything.
            RehybError: the coordinator refuses a study.
        """
        try:
            return self._run()
        finally:
            self._save()

    def _run(self) -> Report:
        from sim.models import MODELS

        model = MODELS[self._plan.model]
        phase1 = self._phase(
            1,
            "screening (elementary effects)",
            {"method": "morris", "rows": self._plan.screening_rows},
        )
        decision = self._decide(phase1["indices"])
        fixed = model.factor(decision["fixed"])
        unit = "" if fixed.unit == "1" else f" {fixed.unit}"
        phase2 = self._phase(
            2,
            f"variance (Sobol indices), {fixed.name} fixed at {fixed.nominal:g}{unit}",
            {
                "method": "saltelli",
                "rows": self._plan.variance_rows,
                "fixed": {fixed.name: fixed.nominal},
                "factors": [
                    {"name": factor.name, "range": [factor.low, factor.high]}
                    for factor in model.sampled
                    if factor.name != fixed.name
                ],
            },
        )
        return self._report(decision, fixed.nominal, phase1, phase2)

    def _phase(self, number: int, title: str, study: Json) -> Json:
        """Run one study to its end and return {"study", "progress", "indices"}."""
        begun = self._manifest["phases"][number - 1]
        # Kept, because the coordinator takes a key again only with the very same study.
        begun["study"] = begun["study"] or {
            "name": f"phase {number}: {title}",
            "model": self._plan.model,
            "sampling": self._plan.sampling,
            "seed": self._plan.seed,
            **study,
        }
        self._save()
        submitted = self._ask(
            lambda: self._client.submit(begun["study"], idempotency_key=begun["key"])
        )
        study_id = submitted["id"]
        while True:
            progress = self._ask(lambda: self._client.progress(study_id))
            snapshot = self._ask(lambda: self._client.indices(study_id))
            done, waiting = _is_done(progress, snapshot)
            if done and (more := self._more_rows(number, snapshot, progress["rows"])):
                submitted = self._ask(partial(self._client.extend, study_id, more))
                done = False
            self._view = View(
                phase=number,
                title=title,
                output=self._plan.output,
                progress=progress,
                snapshot=snapshot,
                waiting=waiting,
            )
            self._show(self._view)
            if done:
                break
            time.sleep(POLL_SECONDS)
        phase = {"study": submitted, "progress": progress, "indices": snapshot}
        _write(self._directory / f"phase{number}.json", phase)
        table = self._directory / f"phase{number}.csv"
        self._ask(lambda: self._client.results_csv(study_id, table))
        return phase

    def _more_rows(self, number: int, snapshot: Json, rows: int) -> int | None:
        """Return how many rows a complete phase is to have in all; None if it has enough."""
        if number == 1 or self._plan.most_rows is None:
            return None
        from analysis.sensitivity.stopping import Goal

        goal = Goal(output=self._plan.output, target=self._plan.target, up_to=self._plan.most_rows)
        step = decide(snapshot, rows, goal)
        if step is None:
            return None
        self._manifest["precision"] = step.sentence
        return step.rows

    def _ask(self, call: Callable[[], T]) -> T:
        """Make a call of the client; once the coordinator was there, wait for it to come back."""
        while True:
            self._tick()
            try:
                return call()
            except (Unreachable, ServerError) as error:
                if self._view is None:
                    raise
                self._show(replace(self._view, waiting=f"{error}; trying again"))
            time.sleep(POLL_SECONDS)

    def _decide(self, snapshot: Json) -> Json:
        """Choose the factor to fix, once; a resumed campaign keeps its choice."""
        from analysis.sensitivity.screening import least_influential, propose_fixing
        from sim.models import MODELS

        if decision := self._manifest["decision"]:
            return dict(decision)
        output = self._plan.output
        proposal = propose_fixing(snapshot, output)
        fixed = proposal.factor or least_influential(snapshot, output)
        if fixed is None:
            raise CampaignError(
                f"phase 1 ranks nothing: too few instances gave {output}; see "
                f"{self._directory / 'phase1.csv'} for why, or ask for more rows"
            )
        evidence = proposal.evidence
        if proposal.factor is None:
            evidence += (
                " That does not settle it; as the paper does, phase 2 fixes the least influential "
                f"factor all the same: {fixed}."
            )
        nominal = MODELS[self._plan.model].factor(fixed)
        agreed = self._confirm(
            Proposed(
                factor=fixed,
                value=f"{nominal.nominal:g}{'' if nominal.unit == '1' else ' ' + nominal.unit}",
                evidence=evidence,
                factors=tuple(line["factor"] for line in proposal.table),
                snapshot=snapshot,
            )
        )
        if agreed is None:
            raise CampaignError(
                f"nothing was fixed, and phase 2 waits; phase 1 is in {self._directory}. Run the "
                "same command again to decide otherwise"
            )
        if agreed != fixed:
            evidence += f" Asked, the user fixed {agreed} instead."
        decision = {
            "fixed": agreed,
            "separated": agreed == proposal.factor,
            "evidence": evidence,
        }
        self._manifest["decision"] = decision
        self._save()
        return decision

    def _report(self, decision: Json, fixed_at: float, phase1: Json, phase2: Json) -> Report:
        from analysis.reports.figures import campaign_figure
        from sim.models import MODELS

        output = self._plan.output
        unit = MODELS[self._plan.model].units[output]
        picture = self._directory / "campaign.png"
        unit = "" if unit == "1" else unit
        campaign_figure(phase1["indices"], phase2["indices"], output, unit).savefig(picture)
        failures: dict[str, int] = {}
        for phase in (phase1, phase2):
            for cause, count in phase["progress"]["failures"].items():
                failures[cause] = failures.get(cause, 0) + count
        page = self._directory / "report.html"
        self._write_page(page, decision, fixed_at, (phase1, phase2))
        names = ("phase1.csv", "phase2.csv", "phase1.json", "phase2.json", MANIFEST)
        report = Report(
            plan=self._plan,
            fixed=decision["fixed"],
            fixed_at=fixed_at,
            separated=decision["separated"],
            evidence=decision["evidence"],
            phase1=phase1["indices"],
            phase2=phase2["indices"],
            failures=failures,
            instances=phase1["progress"]["instances"] + phase2["progress"]["instances"],
            seconds=self._seconds(),
            files=(page, self._directory / FIGURES, picture, *map(self._directory.joinpath, names)),
        )
        self._manifest["failures"] = failures
        self._manifest["instances"] = report.instances
        return report

    def _write_page(
        self, page: Path, decision: Json, fixed_at: float, phases: tuple[Json, Json]
    ) -> None:
        from rehyb.reports import write
        from sim.models import MODELS

        unit = MODELS[self._plan.model].factor(decision["fixed"]).unit
        unit = "" if unit == "1" else f" {unit}"
        output = self._plan.output
        write(
            [
                (phase["study"], self._directory / f"phase{number}.csv")
                for number, phase in enumerate(phases, 1)
            ],
            output,
            page,
            title=f"Two-phase sensitivity analysis of {output.replace('_', ' ')}",
            findings=[
                decision["evidence"],
                f"Phase 2 holds {decision['fixed']} at its nominal {fixed_at:g}{unit}.",
                *([self._manifest["precision"]] if "precision" in self._manifest else []),
            ],
            folders={"png": self._directory / FIGURES},
        )

    def _seconds(self) -> float:
        """Return the wall seconds of this session and of those before it."""
        now = time.monotonic()
        self._manifest["seconds"] += now - self._since
        self._since = now
        seconds: float = self._manifest["seconds"]
        return seconds

    def _save(self) -> None:
        self._seconds()
        _write(self._directory / MANIFEST, self._manifest)


def _is_done(progress: Json, snapshot: Json) -> tuple[bool, str]:
    """Return whether the indices are final, and else what is waited for, if not for results."""
    if progress["state"] == "cancelled":
        raise CampaignError(f"study {progress['study']} was cancelled before it was complete")
    if progress["state"] != "complete":
        return False, "" if progress["workers"] else "waiting for a worker"
    if snapshot["rows_complete"] < progress["rows"]:
        return False, (
            f"all results are in; the analysis has seen {snapshot['rows_complete']} "
            f"of {progress['rows']} rows"
        )
    return True, ""


def _manifest(directory: Path, plan: Plan) -> Json:
    """Return the directory's manifest; make it first, so that its keys outlive a lost answer."""
    path = directory / MANIFEST
    directory.mkdir(parents=True, exist_ok=True)
    if path.exists():
        manifest: Json = json.loads(path.read_text())
        # A campaign that an earlier version began lacks what came later.
        if {**LATER, **manifest.get("plan", {})} != asdict(plan):
            raise CampaignError(
                f"{directory} holds a different campaign ({_words(manifest.get('plan'))}): "
                f"ask for that one again, or use another directory"
            )
        return manifest
    manifest = {
        "plan": asdict(plan),
        "phases": [{"key": str(uuid.uuid4()), "study": None} for _ in range(2)],
        "decision": None,
        "seconds": 0.0,
    }
    _write(path, manifest)
    return manifest


def _words(plan: Mapping[str, Any] | None) -> str:
    return ", ".join(f"{name} {value}" for name, value in (plan or {}).items())


def _write(path: Path, content: Json) -> None:
    """Write JSON so that a reader, or a resumed campaign, never finds half a file."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
    partial.replace(path)
