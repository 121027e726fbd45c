"""What a finished campaign found, and the files that it writes about it."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from rehyb.campaign.decisions import nominal_value
from rehyb.campaign.manifest import MANIFEST
from rehyb.campaign.plans import Plan
from rehyb.client import Json

#: The folder of every figure of the page as PNG.
FIGURES = "figures"


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


def write_report(
    directory: Path,
    plan: Plan,
    decision: Json,
    phases: tuple[Json, Json],
    *,
    seconds: Callable[[], float],
    precision: str | None,
) -> Report:
    """Write the page and the figures about a finished campaign.

    Args:
        directory: the campaign's, which has the phases' tables.
        plan: what was computed.
        decision: from `decided`.
        phases: {"study", "progress", "indices"} of each.
        seconds: tells the wall time that the campaign has run.
        precision: what was last said of phase 2's precision goal.
    """
    from analysis.reports.figures import campaign_figure
    from rehyb.reports import write
    from sim.models import MODELS

    model, output, fixed = MODELS[plan.model], plan.output, decision["fixed"]
    unit = model.units[output]
    phase1, phase2 = (phase["indices"] for phase in phases)
    picture, page = directory / "campaign.png", directory / "report.html"
    campaign_figure(phase1, phase2, output, "" if unit == "1" else unit).savefig(picture)
    findings = [
        decision["evidence"],
        f"Phase 2 holds {fixed} at its nominal {nominal_value(plan, fixed)}.",
    ]
    write(
        [(phase["study"], directory / f"phase{n}.csv") for n, phase in enumerate(phases, 1)],
        output,
        page,
        title=f"Two-phase sensitivity analysis of {output.replace('_', ' ')}",
        findings=findings if precision is None else [*findings, precision],
        folders={"png": directory / FIGURES},
    )
    failures = Counter[str]()
    for phase in phases:
        failures.update(phase["progress"]["failures"])
    names = ("phase1.csv", "phase2.csv", "phase1.json", "phase2.json", MANIFEST)
    return Report(
        plan=plan,
        fixed=fixed,
        fixed_at=model.factor(fixed).nominal,
        separated=decision["separated"],
        evidence=decision["evidence"],
        phase1=phase1,
        phase2=phase2,
        failures=dict(failures),
        instances=sum(phase["progress"]["instances"] for phase in phases),
        seconds=seconds(),
        files=(page, directory / FIGURES, picture, *map(directory.joinpath, names)),
    )
