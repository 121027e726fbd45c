"""Check a bundle without believing it: hashes, design, ledger, indices, a sample of its runs."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from rehyb.again import Code
from rehyb.bundle.archive import MANIFEST, MEMBERS, OF_MODEL, Bundle, in_words, versions
from rehyb.bundle.runs import SAMPLE, TOLERANCE, Judgement, chosen_of, computed_again
from rehyb.bundle.study import lies_in, places_of, plan_of, table_of
from rehyb.errors import Invalid

if TYPE_CHECKING:
    from analysis.sensitivity.table import Table
    from server.records import Plan

#: Largest share by which a recomputed parameter or index may differ where the bits do: other
#: versions of NumPy and SciPy round sums and quantiles differently.
ROUNDING = 1e-9


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
        plan, table = plan_of(bundle), table_of(bundle)
    except Invalid as error:
        yield Finding("contents", False, str(error))
        return
    yield Finding("design", *_design(plan, table))
    yield Finding("failures", *_failures(bundle, table))
    yield Finding("indices", *_indices(bundle, table))
    chosen = chosen_of(plan, table, sample, seed)
    yield Finding("runs", *computed_again(bundle, plan, table, chosen, tolerance, code or Code()))


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


def _design(plan: "Plan", table: "Table") -> Judgement:
    """Compare every parameter with the one that the study's seed gives."""
    from server.logic.study.points import parameters

    places = places_of(table)
    outside = [place for place in places if not lies_in(plan, place)]
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
    of = "" if len(places) == plan.instances else f" (of {plan.instances:,} instances)"
    return True, (
        f"the parameters of {len(places):,} results{of} follow from seed {plan.seed}, {how}"
    )


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
    from analysis.sensitivity.estimator_state import EstimatorState

    state = EstimatorState(table.plan)
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
            f"since {in_words(made)} made them and this is {in_words(here)}"
        )
    return False, (
        f"{len(differences)} numbers in indices.json do not come out of the results, {where} most"
    )


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
