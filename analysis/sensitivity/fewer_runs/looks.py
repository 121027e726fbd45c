"""What a study of method surrogate keeps, and what its snapshot says at each look.

The indices are those of the first 128, 256, 512 rows of the design (`limits.LOOKS`), once all of
them are in. So they are a function of the results, whatever their order
(docs/decisions/0004-sums-do-not-depend-on-order.md).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import unit_row
from analysis.json_values import plain
from analysis.sensitivity.fewer_runs.limits import FEWEST_RUNS, LOOKS, MOST_RUNS
from analysis.sensitivity.judgement.screening import influence
from analysis.sensitivity.judgement.trust import Trust
from analysis.sensitivity.records import StudyPlan

Array = NDArray[np.float64]

_INDICES = ("first_order", "total_order")


class Looks:
    """The values of a study's first rows, and what was found in them."""

    def __init__(self, plan: StudyPlan, outputs: Sequence[str], level: float) -> None:
        self._plan, self._outputs, self._level = plan, tuple(outputs), level
        #: Shape (rows, outputs); inf where no result came yet, nan where the run failed.
        self._values = np.full((MOST_RUNS, len(self._outputs)), np.inf)
        #: By number of rows, and by output: as JSON, or None.
        self._found: dict[int, dict[str, Any]] = {}

    def add_rows(self, rows: Sequence[int], values: Array) -> None:
        """Take in rows; `values` has shape (rows, 1, outputs), nan where a run failed."""
        for row, found in zip(rows, values, strict=True):
            if row < MOST_RUNS:
                self._values[row] = found[0]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all of it as arrays that `load` takes."""
        found = json.dumps(self._found, sort_keys=True).encode()
        return {"values": self._values, "found": np.frombuffer(found, dtype=np.uint8)}

    def load(self, values: Array, found: NDArray[np.uint8]) -> None:
        """Replace all by what `arrays` returned."""
        self._values = values
        self._found = {int(rows): one for rows, one in json.loads(found.tobytes()).items()}

    def onto(self, snapshot: dict[str, Any]) -> dict[str, Any]:
        """Return a snapshot with what the looks say of each output (Da Veiga and Gamboa 2013)."""
        self._look()
        shown = {
            name: self._shown(name, entry) if name in self._outputs else entry
            for name, entry in snapshot["outputs"].items()
        }
        return {**snapshot, "outputs": shown}

    def _look(self) -> None:
        """Answer where all rows are in and nothing was said yet."""
        missing = np.isinf(self._values).any(axis=1)
        there = int(np.argmax(missing)) if missing.any() else len(missing)
        for runs in LOOKS:
            if runs <= there and runs not in self._found:
                self._found[runs] = self._answers(runs)

    def _answers(self, runs: int) -> dict[str, Any]:
        # It takes a second to import.
        from analysis.sensitivity.fewer_runs.answer import answer

        plan = self._plan
        x = np.concatenate(
            [
                unit_row(plan.method, plan.sampling, plan.seed, row, len(plan.factors))
                for row in range(runs)
            ]
        )
        normal = [factor in plan.normal for factor in plan.factors]
        said: dict[str, Any] = {}
        for name, y in zip(self._outputs, self._values[:runs].T, strict=True):
            one = answer(x, y, plan.seed, self._level, normal=normal)
            said[name] = one and {
                "surrogate": {
                    "kind": one.surrogate,
                    "runs": one.runs,
                    "explained": one.found.explained,
                },
                "doubt": one.doubt,
                "indices": {
                    index: {
                        end: getattr(getattr(one.found, index), end).tolist()
                        for end in ("value", "low", "high")
                    }
                    for index in _INDICES
                },
            }
        return said

    def _shown(self, name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Return what is said of an output, with its indices."""
        answered = {runs: self._found[runs][name] for runs in LOOKS if runs in self._found}
        answered = {runs: one for runs, one in answered.items() if one is not None}
        if not answered:
            return dict(entry)
        runs, last = max(answered.items())
        doubt, factors = last["doubt"], self._plan.factors
        trust = Trust(
            runs=runs,
            effective_runs=None,
            unseen=3.0 / runs,
            trusted=None if runs < FEWEST_RUNS else not doubt,
            sentence=f"Do not trust these intervals: {doubt}." if doubt else "",
        )
        of_factors = {
            factor: {
                **entry["factors"][factor],
                **{
                    index: {end: ends[f] for end, ends in last["indices"][index].items()}
                    for index in _INDICES
                },
            }
            for f, factor in enumerate(factors)
        }
        screening = influence(of_factors, self._plan.method, trusted=trust.trusted is True)
        return {
            **entry,
            "factors": of_factors,
            "surrogate": last["surrogate"],
            "trust": plain(trust),
            "screening": plain(screening),
            "convergence": {
                "rows": list(answered),
                "factors": {
                    factor: {
                        index: {
                            end: [one["indices"][index][end][f] for one in answered.values()]
                            for end in ("value", "low", "high")
                        }
                        for index in _INDICES
                    }
                    for f, factor in enumerate(factors)
                },
            },
        }
