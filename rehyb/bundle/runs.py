"""A sample of a bundle's runs, computed again."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rehyb.again import Code, evaluating, not_here
from rehyb.bundle.archive import Bundle, in_words
from rehyb.bundle.study import lies_in, model_of, places_of
from rehyb.client import Json
from rehyb.errors import RehybError

if TYPE_CHECKING:
    from analysis.sensitivity.table import Table
    from models.evaluation import Evaluation
    from server.records import Plan

#: Runs recomputed, and how far their outputs may be off, as a share of the output's standard
#: deviation over the study. The same code on the same kind of machine gives the same bits.
SAMPLE = 10
TOLERANCE = 1e-6

#: Whether a check holds, and a sentence about it.
Judgement = tuple[bool, str]


def chosen_of(plan: "Plan", table: "Table", sample: int, seed: int) -> list[int]:
    """Choose the results to compute again, of those that say more of the model than a machine."""
    from server.logic.study.instances import BUDGETS

    eligible = [
        line
        for line, place in enumerate(places_of(table))
        if table.outcomes[line] not in BUDGETS and lies_in(plan, place)
    ]
    chosen = np.random.default_rng(seed).choice(
        np.array(eligible, dtype=np.int64), min(sample, len(eligible)), replace=False
    )
    return sorted(chosen.tolist())


def computed_again(
    bundle: Bundle,
    plan: "Plan",
    table: "Table",
    chosen: list[int],
    tolerance: float,
    code: Code,
) -> Judgement:
    """Compute the runs of these lines again, and compare what comes out.

    Args:
        bundle: what they are of.
        plan: of its study.
        table: its results.
        chosen: lines of `table`.
        tolerance: how far an output may differ, in its standard deviations.
        code: where the code of a model is that is neither rehyb's own nor in the bundle.
    """
    try:
        with _evaluator(bundle, code) as evaluate:
            return _judged(bundle, plan, table, chosen, tolerance, evaluate)
    except RehybError as error:
        return False, f"none could be computed again: {error}; --sample 0 leaves them out"


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


def _judged(
    bundle: Bundle,
    plan: "Plan",
    table: "Table",
    chosen: list[int],
    tolerance: float,
    evaluate: "Callable[[Json], Evaluation]",
) -> Judgement:
    """Compute some runs again."""
    from server.logic.study.points import parameters, point

    sd = np.array([_spread(column) for column in table.values.T])
    worst, where, differing = 0.0, "", set[int]()
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
            if off > tolerance:
                differing.add(i)
            if off > worst:
                worst, where = off, f"{output} of {name}"
    stated = f"{len(chosen)} of {len(table.outcomes):,} runs, computed again,"
    code = _code(bundle.manifest)
    if worst > tolerance:
        return False, (
            f"of {stated} {len(differing):,} differ by up to {worst:.2g} standard deviations "
            f"({where}), more than {tolerance:g}{code}"
        )
    how = "bit for bit" if worst == 0.0 else f"to {worst:.1g} standard deviations ({where})"
    return True, f"{stated} come out {how}{code}"


def _code(manifest: Mapping[str, Any]) -> str:
    """Say what code computed the study, if it is not what is installed here."""
    from sim.evaluation import identity

    mine, theirs = identity(), manifest.get("identity")
    if theirs == mine or not isinstance(theirs, dict):
        return ""
    return f"; it was computed with {in_words(theirs)}, and this is {in_words(mine)}"


def _spread(column: Any) -> float:
    """Return the standard deviation of what is finite; 1 if there is none."""
    finite = column[np.isfinite(column)]
    sd = float(np.std(finite)) if finite.size else 0.0
    return sd or 1.0
