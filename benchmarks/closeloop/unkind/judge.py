"""One session, from drawing to judging: what was true, and what the product answered."""

import json
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path
from typing import Any

from analysis.closeloop.errors import SessionError
from analysis.closeloop.loop import analyse, close_loop
from benchmarks.closeloop.unkind.cases import Case
from benchmarks.closeloop.unkind.session import record, write_session
from benchmarks.closeloop.unkind.simulate import FlightError

#: An event is at a push if it overlaps it or misses it by less, s.
NEAR = 0.25
#: Every so manieth session is answered with all its files: pictures and simulations take longer
#: than the answer, which is the same without them.
WHOLE = 5


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Truth and answer of one session; names are pairs of effect and joint."""

    case: str
    world: str
    kind: str
    sensor: str
    timing: str
    #: Share of samples lost or held.
    share: float
    truth: tuple[tuple[str, str], ...]
    #: No sensor of this chain can see one of the effects; such sessions count nowhere.
    weak: bool
    verdict: str
    names: tuple[tuple[str, str], ...]
    #: The first name with all that it cannot be told from.
    returned: tuple[str, ...]
    #: Relative errors of K; None without a limb.
    before: float | None
    after: float | None
    covered: bool | None
    #: Pushes, and those that an event is at.
    pushes: int
    found_pushes: int
    #: Held-out gain over what the true torque would gain; None where nothing is to be gained.
    gain: float | None
    seconds: float
    #: The same over what a fit of the true effects gains; of an arm only.
    fitted_gain: float | None = None
    #: First line of a refusal or a crash.
    trouble: str = ""


def kept_at(sessions: Path, case: Case) -> Path:
    """Return the folder of a case's session among those that are kept."""
    return sessions / case.name.replace(":", "_")


def recorded(case: Case, folder: Path) -> dict[str, Any]:
    """Return the truth of the session in `folder`, which is recorded if it is not there yet.

    A robot that cannot be made to follow is a session that does not count.
    """
    truth = Path(f"{folder}.truth.json")
    if truth.exists():
        return dict(json.loads(truth.read_text()))
    shutil.rmtree(folder, ignore_errors=True)
    try:
        return write_session(folder, record(case))
    except FlightError as error:
        lost = {"weak": True, "effects": [], "pushes": [], "flight": str(error)}
        truth.parent.mkdir(parents=True, exist_ok=True)
        truth.write_text(json.dumps(lost))
        return lost


def run(case: Case, folder: Path | None = None, *, whole: bool = False) -> Outcome:
    """Record a case, close its loop, and judge the answer.

    Args:
        case: the session.
        folder: where its session is, or is to be kept; None for nowhere.
        whole: write the report with all its files beside it.
    """
    if folder is None:
        with tempfile.TemporaryDirectory() as scratch:
            return run(case, Path(scratch) / "session", whole=whole)
    truth = recorded(case, folder)
    if "flight" in truth:
        return _outcome(case, truth, None, 0.0, truth["flight"])
    started = time.perf_counter()
    report, trouble = None, ""
    try:
        if whole or case.number % WHOLE == 0:
            report = close_loop(folder, folder.with_name(f"{folder.name}.report"))
        else:
            report = analyse(folder).report
    except SessionError as error:
        trouble = f"refused: {error}"
    except Exception as error:  # a crash is an answer, too, and the bench goes on
        trouble = f"crashed: {type(error).__name__}: {error}"
    seconds = time.perf_counter() - started
    outcome = _outcome(case, truth, report, seconds, trouble)
    if report is None or case.world != "arm" or not truth["effects"]:
        return outcome
    return replace(outcome, fitted_gain=_fitted_gain(folder, outcome, report))


def _outcome(
    case: Case, truth: dict[str, Any], report: dict[str, Any] | None, seconds: float, trouble: str
) -> Outcome:
    said = report or {"verdict": trouble.split(":")[0], "effects": [], "impedance": {}}
    effects = said["effects"]
    first = (effects[0]["name"], *effects[0].get("indistinguishable_from", ())) if effects else ()
    before = after = covered = None
    limb = case.robot.limb
    if limb is not None and limb.joint in said["impedance"]:
        found = said["impedance"][limb.joint]["stiffness"]
        before, after = (abs(found[key] / limb.stiffness - 1) for key in ("before", "after"))
        low, high = found["ci90_after"]
        covered = bool(low <= limb.stiffness <= high)
    return Outcome(
        case=case.name,
        world=case.world,
        kind=case.kind,
        sensor=case.chain.sensor,
        timing=case.chain.timing,
        share=case.chain.share,
        truth=tuple((effect["name"], effect["joint"]) for effect in truth["effects"]),
        weak=truth["weak"],
        verdict=said["verdict"],
        names=tuple((effect["name"], effect["joint"]) for effect in effects),
        returned=first,
        before=before,
        after=after,
        covered=covered,
        pushes=len(truth["pushes"]),
        found_pushes=sum(_found(push, said) for push in truth["pushes"]),
        gain=_gain(truth, said),
        seconds=seconds,
        trouble=" ".join(trouble.split())[:300],
    )


def _found(push: dict[str, Any], report: dict[str, Any]) -> bool:
    """Say whether an event at the pushed joint is where the push was."""
    here = report.get("unexplained", {}).get(push["joint"], {})
    return any(
        event["file"] == push["file"]
        and event["from"] < push["to"] + NEAR
        and event["to"] > push["from"] - NEAR
        for event in here.get("events", ())
    )


def _gain(truth: dict[str, Any], report: dict[str, Any]) -> float | None:
    """Return the mean, over joints where something lacks, of gain over possible gain."""
    shares = []
    for joint, true in truth.get("holdout", {}).items():
        said = report.get("error", {}).get("holdout", {}).get(joint)
        if said is None or true["missing"] < true["noise"]:
            continue
        best = max(true["noise"], sqrt(max(said["before"] ** 2 - true["missing"] ** 2, 0.0)))
        if said["before"] > 1.2 * best:
            shares.append((said["before"] - said["after"]) / (said["before"] - best))
    return sum(shares) / len(shares) if shares else None


def _fitted_gain(folder: Path, outcome: Outcome, report: dict[str, Any]) -> float | None:
    """Return the mean, over joints, of gain over that of the true effects' own regression.

    They are declared by name, without values, in a copy of the session: what is declared is fitted
    before anything is looked for. None where nothing is to be gained, or where they cannot be
    declared together.
    """
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "told"
        shutil.copytree(folder, told)
        session = json.loads((told / "session.json").read_text())
        declared = {(d["effect"], d["joint"]) for d in session.get("declared_effects", [])}
        declared |= set(outcome.truth)
        session["declared_effects"] = [{"effect": e, "joint": j} for e, j in sorted(declared)]
        (told / "session.json").write_text(json.dumps(session))
        try:
            fitted = analyse(told).report["error"]["holdout"]
        except SessionError:
            # Not all effects can be declared beside each other.
            return None
    shares = [
        (said["before"] - said["after"]) / (said["before"] - fitted[joint]["before"])
        for joint, said in report.get("error", {}).get("holdout", {}).items()
        if said["before"] > 1.2 * fitted[joint]["before"]
    ]
    return sum(shares) / len(shares) if shares else None


def from_line(line: dict[str, Any]) -> Outcome:
    """Return an outcome that was kept as JSON."""
    content = dict(line)
    for key in ("truth", "names"):
        content[key] = tuple((name, joint) for name, joint in content[key])
    return Outcome(**{**content, "returned": tuple(content["returned"])})
