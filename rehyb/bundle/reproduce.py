"""Check a bundle without believing it: hashes, design, ledger, indices, a sample of its runs."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rehyb.again import Code, evaluating, not_here
from rehyb.bundle.archive import MANIFEST, MEMBERS, OF_MODEL, Bundle, versions
from rehyb.client import Json
from rehyb.errors import Invalid, RehybError

if TYPE_CHECKING:
    from analysis.sensitivity.table import Table
    from models.description import Description
    from models.evaluation import Evaluation
    from server.records import Plan

#: What a study of dependent factors says of them.
_DEPENDENCE = ("correlations", "correlation_kind")
#: Largest share by which a recomputed parameter or index may differ where the bits do: other
#: versions of NumPy and SciPy round sums and quantiles differently.
ROUNDING = 1e-9

#: Runs recomputed, and how far their outputs may be off, as a share of the output's standard
#: deviation over the study. The same code on the same kind of machine gives the same bits.
SAMPLE = 10
TOLERANCE = 1e-6

#: Whether a check holds, and a sentence about it.
Judgement = tuple[bool, str]


@dataclass(frozen=True)
class Finding:
    """One thing that was checked."""

    check: str
    holds: bool
    sentence: str


def check(
    bundle: Bundle,
    *,
    sample: int = SAMPLE,
    seed: int = 1,
    tolerance: float = TOLERANCE,
    code: Code | None = None,
) -> Iterator[Finding]:
    """Yield what is found, one finding per check, until nothing more can be checked.

    Args:
        sample: how many runs to compute again.
        seed: which ones.
        tolerance: how far outputs of those may differ, in standard deviations of the output.
        code: where the code of a model is that is neither rehyb's own nor in the bundle.
    """
    yield Finding("hashes", *_hashes(bundle))
    try:
        plan, table = plan_of(bundle), _table(bundle)
    except Invalid as error:
        yield Finding("contents", False, str(error))
        return
    yield Finding("design", *_design(plan, table))
    yield Finding("failures", *_failures(bundle, table))
    yield Finding("indices", *_indices(bundle, table))
    chosen = _chosen(plan, table, sample, seed)
    try:
        with _evaluator(bundle, code or Code()) as evaluate:
            judgement = _runs(bundle, plan, table, chosen, tolerance, evaluate)
    except RehybError as error:
        judgement = False, f"none could be computed again: {error}; --sample 0 leaves them out"
    yield Finding("runs", *judgement)


def plan_of(bundle: Bundle) -> "Plan":
    """Return its study's plan, drawn up anew and checked as the coordinator would.

    Raises:
        Invalid: it is no study that this version knows.
    """
    from server.errors import InvalidStudyError
    from server.logic.study.plans import FactorChoice, draw_up

    study, model = bundle.study, model_of(bundle)
    try:
        if not 0 <= int(study["seed"]) < 2**63:
            raise ValueError(f"seed {study['seed']} is none")
        return draw_up(
            name=str(study["name"]),
            model=model,
            called=str(study["model"]),
            method=str(study["method"]),
            sampling=str(study["sampling"]),
            rows=int(study["rows"]),
            seed=int(study["seed"]),
            factors=[
                FactorChoice(name=factor["name"], distribution=factor["distribution"])
                for factor in study["factors"]
            ],
            fixed={str(name): float(value) for name, value in study["fixed"].items()},
            outputs=study["outputs"],
            # Earlier versions did not know them.
            correlations=study.get("correlations", ()),
            correlation_kind=study.get("correlation_kind", "rank"),
            groups=study.get("groups", {}),
        )
    except (InvalidStudyError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise Invalid(f"study.json describes no study that can be computed here: {error}") from None
    except KeyError as error:
        raise Invalid(f"study.json describes no study: it has no {error}") from None


def model_of(bundle: Bundle) -> "Description":
    """Return the description of a bundle's model.

    Raises:
        Invalid: it neither comes with rehyb nor is in the bundle as the study names it.
    """
    from models.description import Description, DescriptionError
    from models.own import own_models

    called = str(bundle.study.get("model"))
    if called in own_models():
        return own_models()[called]
    if bundle.model is None:
        raise Invalid(
            f"study.json is of the model {called!r}, which does not come with rehyb, and there is "
            f"no model.json; known are {', '.join(own_models())}"
        )
    try:
        model = Description.from_json(bundle.model)
    except DescriptionError as error:
        raise Invalid(f"model.json describes no model: {error}") from None
    if model.version != called:
        raise Invalid(f"study.json is of the model {called!r}, and model.json of {model.version}")
    return model


@contextmanager
def _evaluator(bundle: Bundle, code: Code) -> Iterator[Callable[[Json], "Evaluation"]]:
    """Yield what evaluates an instance of the bundle's model; what is code only if named."""
    from sim.evaluation import evaluate

    model = model_of(bundle)
    if bundle.model is None:
        # What is optional among the outputs is a curve.
        curves = bundle.study.get("curves", {})
        yield lambda instance: evaluate(instance["model"], instance["parameters"], curves)
        return

    def fetch(version: str, path: Path) -> None:
        if bundle.model_archive is None:
            raise not_here(version, model.kind, code)
        shutil.copyfile(bundle.model_archive, path)

    with evaluating(fetch, code) as again:
        yield again


def request_of(study: Json) -> Json:
    """Return the request that submits the same study again."""
    asked = ("name", "model", "method", "sampling", "rows", "seed", "factors", "outputs", "fixed")
    # It was taken when it was submitted first.
    more = {name: study[name] for name in _DEPENDENCE if study.get("correlations")}
    more |= {"groups": study["groups"]} if study.get("groups") else {}
    return {**{name: study[name] for name in asked}, **more, "outside_range": True}


def _hashes(bundle: Bundle) -> Judgement:
    """Compare the hash of every file with the one in the manifest."""
    stated = bundle.manifest.get("files")
    stated = stated if isinstance(stated, dict) else {}
    members = [*MEMBERS, *(member for member in OF_MODEL if member in bundle.found)]
    wrong = [
        member
        for member in members
        if not isinstance(stated.get(member), dict)
        or stated[member].get("sha256") != bundle.found[member]
    ]
    if wrong:
        return False, f"{', '.join(wrong)}: not what {MANIFEST} states"
    return True, f"{len(members)} files are as {MANIFEST} states"


def _table(bundle: Bundle) -> "Table":
    from analysis.files.results_csv import read_table
    from analysis.sensitivity.records import plan_of

    try:
        return read_table(plan_of(bundle.study), bundle.results)
    except (ValueError, OverflowError, TypeError) as error:
        what = str(error).replace(str(bundle.results), "results.csv")
        raise Invalid(f"results.csv cannot be read: {what}") from None


def _places(table: "Table") -> list[tuple[int, int]]:
    """Return the row and position of every result."""
    return list(zip(table.rows.tolist(), table.positions.tolist(), strict=True))


def _lies_in(plan: "Plan", place: tuple[int, int]) -> bool:
    return 0 <= place[0] < plan.rows and 0 <= place[1] < plan.width


def _design(plan: "Plan", table: "Table") -> Judgement:
    """Compare every parameter with the one that the study's seed gives."""
    from server.logic.study.plans import parameters

    places = _places(table)
    outside = [place for place in places if not _lies_in(plan, place)]
    if outside or len(set(places)) < len(places):
        where = f"{outside[0]} lies outside the study" if outside else "a place occurs twice"
        return False, f"results.csv has rows and positions that no study has: {where}"
    worst, at, row, points = 0.0, (0, 0), -1, list[dict[str, float]]()
    for line, place in enumerate(places):
        if place[0] != row:
            row, points = place[0], parameters(plan, place[0])
        for f, name in enumerate(plan.distributions):
            off = _apart(table.points[line, f], points[place[1]][name])
            if off > worst:
                worst, at = off, place
    if worst > ROUNDING:
        return False, f"row {at[0]}, position {at[1]} is not what seed {plan.seed} gives"
    how = "bit for bit" if worst == 0.0 else f"to {worst:.1g} of their size"
    return True, f"the parameters of {len(places):,} results follow from seed {plan.seed}, {how}"


def _failures(bundle: Bundle, table: "Table") -> Judgement:
    """Compare the failures in the ledger with those in the table."""
    lines = zip(table.rows.tolist(), table.positions.tolist(), table.outcomes, strict=True)
    failed = {line for line in lines if line[2] != "ok"}
    listed = {(one.get("row"), one.get("position"), one.get("outcome")) for one in bundle.failures}
    if failed != listed or len(listed) != len(bundle.failures):
        return False, (
            f"failures.json tells of {len(bundle.failures)} failures, and "
            f"{len(failed & listed)} of the {len(failed)} in results.csv are among them"
        )
    stated = bundle.manifest.get("results")
    if stated != len(table.outcomes):
        return False, (
            f"results.csv has {len(table.outcomes)} results, and {MANIFEST} states {stated}"
        )
    if not failed:
        return True, "no run failed, and the ledger has none"
    return True, f"the ledger tells of every failed run ({len(failed)}), and of no other"


def _indices(bundle: Bundle, table: "Table") -> Judgement:
    """Compute the snapshot again from the results alone."""
    from analysis.sensitivity.study_state import StudyState

    state = StudyState(table.plan)
    try:
        state.take(table.results())
    except ValueError as error:
        return False, f"the results are not of this study: {error}"
    # Where the log stood says nothing about the numbers.
    again = {**state.snapshot(), "cursor": 0}
    differences = list(_differences({**bundle.indices, "cursor": 0}, again))
    if not differences:
        return True, "every index and interval comes out of the results again, bit for bit"
    where, off = max(differences, key=lambda item: item[1])
    made, here = bundle.manifest.get("bundled_with"), versions()
    if off <= ROUNDING and made != here:
        return True, (
            f"every index and interval comes out again to {off:.1g} of its size; not bit for bit, "
            f"since {_in_words(made)} made them and this is {_in_words(here)}"
        )
    return False, (
        f"{len(differences)} numbers in indices.json do not come out of the results, {where} most"
    )


def _chosen(plan: "Plan", table: "Table", sample: int, seed: int) -> list[int]:
    """Choose the results to compute again, of those that say more of the model than a machine."""
    from server.logic.study.instances import BUDGETS

    eligible = [
        line
        for line, place in enumerate(_places(table))
        if table.outcomes[line] not in BUDGETS and _lies_in(plan, place)
    ]
    chosen = np.random.default_rng(seed).choice(
        np.array(eligible, dtype=np.int64), min(sample, len(eligible)), replace=False
    )
    return sorted(chosen.tolist())


def _runs(
    bundle: Bundle,
    plan: "Plan",
    table: "Table",
    chosen: list[int],
    tolerance: float,
    evaluate: "Callable[[Json], Evaluation]",
) -> Judgement:
    """Compute some runs again."""
    from server.logic.study.plans import parameters, point

    sd = np.array([_spread(column) for column in table.values.T])
    worst, where = 0.0, ""
    for i in chosen:
        row, position = int(table.rows[i]), int(table.positions[i])
        name = f"row {row}, position {position}"
        try:
            asked = point(plan, row, parameters(plan, row)[position])
            done = evaluate({"model": plan.model, **asked})
        except ValueError as error:
            return False, f"{name} cannot be computed: {error}"
        if done.outcome != table.outcomes[i]:
            return False, f"{name} came out as {table.outcomes[i]}, and here as {done.outcome}"
        for o, output in enumerate(plan.outputs if done.outcome == "ok" else ()):
            off = float(abs(done.outputs[output] - table.values[i, o]) / sd[o])
            # What is no number is as far off as can be.
            off = off if isfinite(off) else inf
            if off > worst:
                worst, where = off, f"{output} of {name}"
    stated = f"{len(chosen)} of {len(table.outcomes):,} runs, computed again,"
    code = _code(bundle.manifest)
    if worst > tolerance:
        return False, (
            f"{stated} differ by up to {worst:.2g} standard deviations ({where}), more than "
            f"{tolerance:g}{code}"
        )
    how = "bit for bit" if worst == 0.0 else f"to {worst:.1g} standard deviations ({where})"
    return True, f"{stated} come out {how}{code}"


def _code(manifest: Mapping[str, Any]) -> str:
    """Say what code computed the study, if it is not what is installed here."""
    from sim.evaluation import versions as here
    from worker.machine import code

    mine = {"code": code(), "mujoco": here()["mujoco"]}
    theirs = manifest.get("identity")
    if theirs == mine or not isinstance(theirs, dict):
        return ""
    return f"; it was computed with {_in_words(theirs)}, and this is {_in_words(mine)}"


def _spread(column: Any) -> float:
    """Return the standard deviation of what is finite; 1 if there is none."""
    finite = column[np.isfinite(column)]
    sd = float(np.std(finite)) if finite.size else 0.0
    return sd or 1.0


def _differences(a: Any, b: Any, where: str = "") -> Iterator[tuple[str, float]]:
    """Yield where two JSON values differ and by how much; 1 or more if not in a number's size."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in sorted({*a, *b}):
            at = f"{where}/{name}"
            if name in a and name in b:
                yield from _differences(a[name], b[name], at)
            else:
                yield at, 2.0
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, pair in enumerate(zip(a, b, strict=True)):
            yield from _differences(*pair, f"{where}/{i}")
    elif a != b:
        numbers = all(isinstance(x, int | float) and isfinite(x) for x in (a, b))
        yield where, _apart(a, b) if numbers else 2.0


def _apart(a: float, b: float) -> float:
    """Return how far two numbers are apart, as a share of the larger one; 2 if one is none."""
    if a == b:
        return 0.0
    share = float(abs(a - b) / max(abs(a), abs(b)))
    return share if isfinite(share) else 2.0


def _in_words(found: object) -> str:
    pairs = found.items() if isinstance(found, dict) else ()
    return ", ".join(f"{name} {value}" for name, value in pairs) or "nothing known"
