"""Build a bank, or extend one: simulate what is missing, then learn from all of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.interpretation.bank.bank import (
    CONTACT_ROWS,
    LEVELS,
    Bank,
    Samples,
    empty_samples,
)
from analysis.interpretation.bank.population import Population
from analysis.interpretation.bank.sampling import sample
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.inference.interpreter import LEAST_CONTACT, LEAST_ROWS, Interpreter
from sim.evaluation import versions

#: Called with what is done, how many are and how many there are.
Progress = Callable[[str, int, int], None]


def empty_bank(population: Population, seed: int) -> Bank:
    """Return a bank without rows."""
    nothing = empty_samples(len(population.names))
    return Bank(
        population=population,
        seed=seed,
        bushing=nothing,
        contact=nothing,
        versions=versions(),
        fitted={},
    )


def grow(
    bank: Bank,
    *,
    rows: int,
    contact_rows: int,
    processes: int,
    progress: Progress = lambda what, done, total: None,
) -> Bank:
    """Return a bank with as many rows, those that it had among them, and learn from them.

    Args:
        bank: what is there already.
        rows: wearers without contact, in all.
        contact_rows: wearers with contact, in all.
        processes: simulations at a time.
        progress: shows how far it is.

    Raises:
        InterpretationError: other versions made what is there, or the bank is too small.
    """
    if len(bank.bushing) and dict(bank.versions) != versions():
        raise InterpretationError(
            "this bank was made by other versions of rehyb, MuJoCo or NumPy: build a new one"
        )
    check_rows(rows, contact_rows)
    grown = replace(
        bank,
        fitted={},
        bushing=_grown(bank, bank.bushing, "bushing", range(rows), processes, progress),
        contact=_grown(
            bank,
            bank.contact,
            "contact",
            range(CONTACT_ROWS, CONTACT_ROWS + contact_rows),
            processes,
            progress,
        ),
    )
    return learnt(grown, progress)


def learnt(bank: Bank, progress: Progress = lambda what, done, total: None) -> Bank:
    """Return a bank with what its rows teach.

    Raises:
        InterpretationError: the bank is too small.
    """
    progress("learning", 0, 1)
    found = replace(bank, fitted=Interpreter.fit(bank).arrays)
    progress("learning", 1, 1)
    return found


def check_rows(rows: int, contact_rows: int) -> None:
    """Refuse a bank of which too little could be learnt, before it is simulated.

    Raises:
        InterpretationError: `rows` without contact, or `contact_rows` with it, are too few.
    """
    if rows < LEAST_ROWS:
        raise InterpretationError(
            f"{rows} rows without contact are too few to learn from: take {LEAST_ROWS} or more"
        )
    if 0 < contact_rows < LEAST_CONTACT:
        raise InterpretationError(
            f"{contact_rows} rows with contact are too few to learn what contact changes and how "
            f"far intervals must reach: take {LEAST_CONTACT} or more, some of which fail, or 0 for "
            "limbs that are held without contact"
        )


def _grown(
    bank: Bank, had: Samples, level: str, wanted: range, processes: int, progress: Progress
) -> Samples:
    """Return what a bank has of a level, and what is missing of the wanted rows."""
    missing = wanted[had.drawn :]
    if not missing:
        return had
    fresh = sample(
        bank.population,
        bank.seed,
        missing,
        level=level,
        processes=processes,
        progress=lambda done, total: progress(LEVELS[level], done, total),
    )
    return had.joined(fresh)


def describe(bank: Bank) -> dict[str, object]:
    """Return what a bank is, as JSON."""
    return {
        "id": bank.id,
        "population": bank.population.name,
        "seed": bank.seed,
        "bushing": {"recordings": len(bank.bushing), "failed": dict(bank.bushing.failed)},
        "contact": {"recordings": len(bank.contact), "failed": dict(bank.contact.failed)},
        "stiffness": [
            float(value)
            for value in np.quantile(bank.bushing.of("true_stiffness"), [0.05, 0.5, 0.95])
        ]
        if len(bank.bushing)
        else [],
        "versions": dict(bank.versions),
    }
