"""Where the analysis of one study stands: incomplete rows, and what was made of the others.

It does not depend on the order of results (docs/decisions/0004).
"""

import io
import json
import zlib
from collections import Counter
from collections.abc import Iterable
from math import inf, nan
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.curves.points import looked_at
from analysis.sensitivity.estimators import Estimator
from analysis.sensitivity.fewer_runs.looks import Looks
from analysis.sensitivity.records import LARGEST_OUTPUT, LoggedResult, StudyPlan
from analysis.sensitivity.snapshot import (
    LEVEL,
    new_curves,
    new_growing_estimator,
    scalars,
    take_snapshot,
)

#: Changes whenever the meaning of the bytes does.
FORMAT = 6

#: How a run counts that says it succeeded, with an output beyond `LARGEST_OUTPUT`. A coordinator
#: takes none.
OUT_OF_RANGE = "out_of_range"

#: Bounds the memory that the weights of a batch take.
_ROWS_AT_ONCE = 1000


class StaleStateError(ValueError):
    """This state is of another version or study: start again from the log."""


class EstimatorState:
    """All that the results of one study say so far.

    It is a function of the set of results taken in: their order and their batches leave no trace.
    """

    def __init__(self, plan: StudyPlan) -> None:
        self.plan = plan
        #: Sequence number of the last result taken in.
        self.cursor = 0
        self.evaluations: Counter[str] = Counter()
        self._estimator = new_growing_estimator(plan)
        self._curves = new_curves(plan)
        #: Columns of `_partial` for the estimator, and for each curve those that are looked at.
        inside = {name: plan.outputs.index(f"{name}[0]") for name in plan.curves}
        self._at = {
            name: inside[name] + looked_at(plan.curves[name].points, len(plan.units))
            for name in inside
        }
        own = set(scalars(plan))
        self._own = [o for o, name in enumerate(plan.outputs) if name in own]
        #: Of a study of single points, whose indices are no sums over rows.
        self._looks = Looks(plan, scalars(plan), LEVEL) if plan.method == "surrogate" else None
        self._own.append(len(plan.outputs))
        #: Values (width, outputs + 1) of incomplete rows; inf where no result came yet, nan where
        #: the run failed. The last column is 1 for a failed run and 0 for any other.
        self._partial: dict[int, NDArray[np.float64]] = {}
        #: How many results those have: to count them anew takes longer than to take one in.
        self._taken: Counter[int] = Counter()
        #: Which rows are complete.
        self._complete = np.zeros(plan.rows, dtype=np.bool_)

    def take(self, results: Iterable[LoggedResult]) -> int:
        """Take in results and return how many were new.

        A result of a place that is taken already was seen before, and is left out.

        Raises:
            ValueError: a result belongs to no row or position of the study.
        """
        new = 0
        whole: list[int] = []
        for result in results:
            self.cursor = max(self.cursor, result.seq)
            outcome = self._place(result)
            if outcome is not None:
                new += 1
                self.evaluations[outcome] += 1
                if self._taken[result.row] == self._estimator.width:
                    whole.append(result.row)
                    self._complete[result.row] = True
            if len(whole) == _ROWS_AT_ONCE:
                self._add(whole)
                whole = []
        self._add(whole)
        return new

    def snapshot(self) -> dict[str, Any]:
        """Return the snapshot of the study (`analysis.sensitivity.snapshot`)."""
        snapshot = take_snapshot(
            self.plan,
            self.estimator(),
            self._estimator.series,
            cursor=self.cursor,
            rows_complete=int(self._complete.sum()),
            evaluations=self.evaluations,
            curves=self._curves,
        )
        return snapshot if self._looks is None else self._looks.onto(snapshot)

    def estimator(self) -> Estimator:
        """Return the estimator of all complete rows; its last output is the failure indicator."""
        return self._estimator.total()

    def to_bytes(self) -> bytes:
        """Return the state as a compressed NPZ file without pickles."""
        rows = sorted(self._partial)
        curves: dict[str, Any] = {
            f"curve_{name}": _bytes(curve.to_bytes()) for name, curve in self._curves.items()
        }
        kept = {} if self._looks is None else self._looks.arrays()
        looks: dict[str, Any] = {f"looks_{name}": array for name, array in kept.items()}
        buffer = io.BytesIO()
        np.savez(
            buffer,
            format=np.int64(FORMAT),
            study=_bytes(json.dumps(_identity(self.plan)).encode()),
            cursor=np.int64(self.cursor),
            evaluations=_bytes(json.dumps(self.evaluations, sort_keys=True).encode()),
            complete=np.packbits(self._complete),
            partial_rows=np.array(rows, dtype=np.int64),
            partial_values=np.array([self._partial[row] for row in rows], dtype=np.float64),
            estimator=_bytes(self._estimator.to_bytes()),
            **curves,
            **looks,
        )
        # The fastest level already shrinks it to a third.
        return zlib.compress(buffer.getvalue(), level=1)

    @classmethod
    def from_bytes(cls, plan: StudyPlan, data: bytes) -> Self:
        """Return the state that `to_bytes` returned for the same study.

        Raises:
            StaleStateError: the bytes are of another format or of another study.
        """
        state = cls(plan)
        with np.load(io.BytesIO(zlib.decompress(data)), allow_pickle=False) as saved:
            if int(saved["format"]) != FORMAT:
                raise StaleStateError(f"the state has format {saved['format']}, not {FORMAT}")
            if json.loads(saved["study"].tobytes()) != _identity(plan):
                raise StaleStateError(f"the state does not belong to study {plan.id} as planned")
            state.cursor = int(saved["cursor"])
            state.evaluations = Counter(json.loads(saved["evaluations"].tobytes()))
            complete = np.unpackbits(saved["complete"], count=plan.rows)
            state._complete = complete.astype(np.bool_)
            state._partial = {
                int(row): values
                for row, values in zip(saved["partial_rows"], saved["partial_values"], strict=True)
            }
            for row, values in state._partial.items():
                state._taken[row] = int((values[:, -1] < inf).sum())
            state._estimator.load_bytes(saved["estimator"].tobytes())
            for name, curve in state._curves.items():
                curve.load_bytes(saved[f"curve_{name}"].tobytes())
            if state._looks is not None:
                state._looks.load(saved["looks_values"], saved["looks_found"])
        return state

    def _add(self, rows: list[int]) -> None:
        """Hand complete rows over to the estimator."""
        if rows:
            values = np.stack([self._partial.pop(row) for row in rows])
            for row in rows:
                del self._taken[row]
            self._estimator.add_rows(rows, values[:, :, self._own])
            for name, curve in self._curves.items():
                curve.add_rows(rows, values[:, :, self._at[name]])
            if self._looks is not None:
                self._looks.add_rows(rows, values[:, :, self._own[:-1]])

    def _place(self, result: LoggedResult) -> str | None:
        """Put a result in its row and return how it counts; None if its place is taken."""
        width = self._estimator.width
        if not (0 <= result.row < self.plan.rows and 0 <= result.position < width):
            raise ValueError(
                f"study {self.plan.id} has {self.plan.rows} rows of {width} positions: "
                f"instance {result.instance} is at row {result.row}, position {result.position}"
            )
        if self._complete[result.row]:
            return None
        outputs = self.plan.outputs
        values = self._partial.get(result.row)
        if values is None:
            values = self._partial[result.row] = np.full((width, len(outputs) + 1), inf)
        if values[result.position, -1] < inf:
            return None
        outcome, ok = result.outcome, result.outcome == "ok"
        if ok:
            found = [result.outputs.get(name, nan) for name in outputs]
            # As a loop over `abs(value) > LARGEST_OUTPUT`, in a third of the time.
            if any(map(LARGEST_OUTPUT.__lt__, map(abs, found))):
                outcome, ok = OUT_OF_RANGE, False
        values[result.position] = [*found, 0.0] if ok else [nan] * len(outputs) + [1.0]
        self._taken[result.row] += 1
        return outcome


def _identity(plan: StudyPlan) -> list[Any]:
    """Return what a state depends on, as JSON; not the number of rows, which may grow."""
    about = [plan.id, plan.method, plan.seed, plan.sampling, list(plan.factors), list(plan.outputs)]
    about += [list(plan.curves)] if plan.curves else []
    return (
        [*about, [[name, list(members)] for name, members in plan.groups.items()]]
        if plan.groups
        else about
    )


def _bytes(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, dtype=np.uint8)
