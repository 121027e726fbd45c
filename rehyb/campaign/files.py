"""What a campaign keeps in its directory: its manifest, and in the end its report."""

import json
import uuid
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from rehyb.campaign.decisions import nominal_value
from rehyb.campaign.plans import Plan
from rehyb.client import Json
from rehyb.errors import CampaignError
from rehyb.whole_files import make_folder, write_json

MANIFEST = "campaign.json"
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
        decision: from `decided`.
        phases: {"study", "progress", "indices"} of each.
        seconds: returns the wall time that the campaign has run.
        precision: the last decision about phase 2's precision goal, a sentence.
    """
    from analysis.reports.figures import campaign
    from analysis.reports.paper import on_paper
    from rehyb.reports import write

    model, output, fixed = plan.description, plan.output, decision["fixed"]
    unit = model.units[output]
    phase1, phase2 = (phase["indices"] for phase in phases)
    picture, page = directory / "campaign.png", directory / "report.html"
    drawn = campaign(phase1, phase2, output, "" if unit == "1" else unit)
    on_paper(drawn).savefig(picture)
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


def load_manifest(directory: Path, plan: Plan) -> Json:
    """Return the directory's manifest; make it first, so that its keys outlive a lost answer.

    Returns:
        {"plan", "phases": each with "key" and "study", "decision", "seconds"}.

    Raises:
        CampaignError: the directory holds a campaign with a different plan, or a broken manifest.
        Invalid: it is a file.
    """
    path = directory / MANIFEST
    make_folder(directory, "a campaign")
    if path.exists():
        manifest = _read(path)
        # A campaign that an earlier version began lacks what came later.
        later: Json = {"most_rows": None, "target": None, "fixed": {}, "ranges": "table_1"}
        later |= {"outside_range": False, "described": None}
        kept: Json = manifest.get("plan", {})
        there, asked = {**later, **kept}, asdict(plan)
        if there != asked:
            words = ", ".join(
                # A description is as long as the model.
                f"the model {plan.model} described otherwise"
                if name == "described"
                else f"{name} {there.get(name)}, not {value}"
                for name, value in asked.items()
                if there.get(name) != value
            )
            raise CampaignError(
                f"{directory} holds a different campaign ({words}): "
                f"ask for that one again, or use another directory"
            )
        return manifest
    manifest = {
        "plan": asdict(plan),
        "phases": [{"key": str(uuid.uuid4()), "study": None} for _ in range(2)],
        "decision": None,
        "seconds": 0.0,
    }
    write_json(path, manifest)
    return manifest


def _read(manifest: Path) -> Json:
    try:
        found = json.loads(manifest.read_bytes())
    except ValueError as error:
        why = f"is no JSON ({error})"
    else:
        if isinstance(found, dict) and isinstance(found.get("plan", {}), dict):
            return found
        why = "is no manifest of a campaign"
    raise CampaignError(
        f"{manifest} {why}: restore it, or use another directory to begin the campaign anew"
    )
