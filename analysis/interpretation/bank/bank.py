"""A bank: simulated recordings of a population, with the truth behind each, in one file.

Many rows are without contact (bushings, milliseconds each) and few with it; the few say what the
many get wrong (Kennedy and O'Hagan 2000, an autoregressive model of two codes). The file is a NumPy
archive without pickle.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from analysis.interpretation.bank.archive import is_finite, read_arrays
from analysis.interpretation.bank.population import (
    WITH_CONTACT,
    WITHOUT_CONTACT,
    Population,
    population_of,
)
from analysis.interpretation.errors import InterpretationError
from intake.arrays import DamagedArraysError
from sim.models import CURVES, ESTIMATES, TRUTHS

#: Of the format of the file.
SCHEMA = 1
#: Shares of the human joint's travel at which local stiffness is known.
PLACES = {"start": 0.1, "middle": 0.5, "end": 0.9}
LOCAL = tuple(f"local_stiffness_{place}" for place in PLACES)
#: Regressions of the whole recording, for comparison.
REGRESSIONS = ("stiffness_estimate", "stiffness_estimate_paper")
#: What is kept of a simulated recording.
KEPT = (*CURVES, *ESTIMATES, *TRUTHS, *LOCAL, *REGRESSIONS)
#: Numbers of the rows with contact begin here: no wearer is in both parts.
CONTACT_ROWS = 1 << 20
LEVELS = {"bushing": WITHOUT_CONTACT, "contact": WITH_CONTACT}


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Simulated recordings of one level: n wearers whose assessment could be believed."""

    #: Numbers of the wearers in their population, shape (n,).
    rows: np.ndarray
    #: Their factors, shape (n, factors).
    factors: np.ndarray
    #: `KEPT` of each, shape (n, len(KEPT)).
    values: np.ndarray
    #: How many ended otherwise, by outcome.
    failed: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def drawn(self) -> int:
        """How many wearers were simulated."""
        return len(self) + sum(self.failed.values())

    def of(self, *names: str) -> np.ndarray:
        """Return some of `KEPT`, shape (n, len(names))."""
        return self.values[:, [KEPT.index(name) for name in names]]

    def curves(self, zero_errors: np.ndarray) -> np.ndarray:
        """Return curves and regressions as sensors with `zero_errors` (n, joints) show them.

        A zero error shifts the torque of a joint: its curve, and nothing of the affine regression.
        """
        return with_zero_errors(self.of(*CURVES, *ESTIMATES), zero_errors)

    def joined(self, other: "Samples") -> "Samples":
        """Return both."""
        names = {*self.failed, *other.failed}
        return Samples(
            rows=np.concatenate([self.rows, other.rows]),
            factors=np.concatenate([self.factors, other.factors]),
            values=np.concatenate([self.values, other.values]),
            failed={n: self.failed.get(n, 0) + other.failed.get(n, 0) for n in sorted(names)},
        )

    def some(self, chosen: np.ndarray) -> "Samples":
        """Return the wearers that `chosen` (indices or a mask) says."""
        return Samples(
            rows=self.rows[chosen],
            factors=self.factors[chosen],
            values=self.values[chosen],
            failed=self.failed,
        )


def with_zero_errors(recorded: np.ndarray, zero_errors: np.ndarray) -> np.ndarray:
    """Return CURVES and ESTIMATES, shape (n, both), with zero errors (n, joints) on the torques.

    The motor's torque is subtracted from what the declared model needs, so a zero error of +1 Nm
    lowers the curve by 1 Nm. What equation 21, without a constant, makes of it is left out.
    """
    shifted = recorded.copy()
    for joint in range(zero_errors.shape[1]):
        own = [i for i, name in enumerate(CURVES) if name.startswith(f"torque_J{joint + 1}_")]
        shifted[:, own] -= zero_errors[:, [joint]]
    return shifted


def empty_samples(factors: int) -> Samples:
    """Return no samples."""
    return Samples(
        rows=np.empty(0, dtype=np.int64),
        factors=np.empty((0, factors)),
        values=np.empty((0, len(KEPT))),
        failed={},
    )


@dataclass(frozen=True, kw_only=True)
class Bank:
    """Recordings of a population, and what was learnt from them."""

    population: Population
    seed: int
    bushing: Samples
    contact: Samples
    #: MuJoCo, NumPy and so on that made it.
    versions: Mapping[str, str]
    #: Arrays of the fit by name (`analysis.interpretation.inference.interpreter`); empty before it.
    fitted: Mapping[str, np.ndarray]

    @cached_property
    def id(self) -> str:
        """Name of all that answers rest on.

        What is learnt from the same rows differs in its last digits by how many threads summed it,
        and the answers by 1e-5: banks that were built apart have names of their own.
        """
        digest = hashlib.sha256(json.dumps(self.population.content, sort_keys=True).encode())
        digest.update(json.dumps([SCHEMA, self.seed, dict(self.versions)], sort_keys=True).encode())
        for part in (self.bushing, self.contact):
            for array in (part.rows, part.factors, part.values):
                digest.update(array.tobytes())
        for name, array in sorted(self.fitted.items()):
            digest.update(name.encode())
            digest.update(np.asarray(array).tobytes())
        return digest.hexdigest()[:12]

    def save(self, path: Path) -> None:
        """Write the bank to one file."""
        meta: dict[str, Any] = {
            "schema": SCHEMA,
            "id": self.id,
            "seed": self.seed,
            "population": self.population.content,
            "versions": dict(self.versions),
            "kept": list(KEPT),
            "failed": {"bushing": self.bushing.failed, "contact": self.contact.failed},
        }
        arrays = {f"fitted.{name}": array for name, array in self.fitted.items()}
        for level, part in (("bushing", self.bushing), ("contact", self.contact)):
            arrays |= {
                f"{level}.rows": part.rows,
                f"{level}.factors": part.factors,
                f"{level}.values": part.values,
            }
        # Through a file, since NumPy adds an ending to a path that lacks it.
        with path.open("wb") as file:
            np.savez(file, meta=np.array(json.dumps(meta)), **arrays)  # type: ignore[arg-type]


def load_bank(path: Path) -> Bank:
    """Read a bank.

    Raises:
        InterpretationError: there is none, it is of another version, or damaged.
    """
    if path.is_dir():
        raise InterpretationError(f"{path} is a folder, and a bank is one file: name a file")
    if not path.is_file():
        raise InterpretationError(
            f"there is no bank at {path}: `rehyb bank build --out {path}` makes one"
        )
    try:
        arrays = read_arrays(path)
        meta = json.loads(str(arrays.pop("meta")))
    except DamagedArraysError as error:
        raise InterpretationError(f"{path} is a bank that {error}") from None
    except (ValueError, KeyError, RecursionError):
        raise InterpretationError(
            f"{path} is no bank: `rehyb bank build --out FILE` makes one"
        ) from None
    meta = meta if isinstance(meta, dict) else {}
    if meta.get("schema") != SCHEMA or meta.get("kept") != list(KEPT):
        raise InterpretationError(
            f"{path} is a bank of another version of rehyb: build it again with `rehyb bank build`"
        )
    _check(arrays, meta, path)
    parts = {
        level: Samples(
            rows=arrays.pop(f"{level}.rows"),
            factors=arrays.pop(f"{level}.factors"),
            values=arrays.pop(f"{level}.values"),
            failed=meta["failed"][level],
        )
        for level in LEVELS
    }
    bank = Bank(
        population=population_of(meta["population"], str(path)),
        seed=meta["seed"],
        versions=meta["versions"],
        fitted={name.removeprefix("fitted."): array for name, array in arrays.items()},
        **parts,
    )
    # A cut array may fit the others, and still answer; no shape is known but by what was saved.
    if bank.id != meta["id"]:
        raise InterpretationError(
            f"{path} is a damaged bank, or of another version of rehyb: its arrays are not those "
            f"of bank {str(meta['id'])[:12]}; build it again with `rehyb bank build`"
        )
    return bank


def _check(arrays: Mapping[str, np.ndarray], meta: Mapping[str, Any], path: Path) -> None:
    """Raise InterpretationError if something is missing, not finite, or does not fit."""
    own = [f"{level}.{part}" for level in LEVELS for part in ("rows", "factors", "values")]
    missing = [name for name in own if name not in arrays]
    missing += [
        name for name in ("id", "population", "seed", "versions", "failed") if name not in meta
    ]
    if missing:
        raise InterpretationError(f"{path} is a damaged bank: it has no {missing[0]}")
    for name, array in arrays.items():
        if not is_finite(array):
            raise InterpretationError(
                f"{path} is a damaged bank: {name} has values that are not finite numbers"
            )
    for level in LEVELS:
        rows, factors, values = (
            arrays[f"{level}.{part}"] for part in ("rows", "factors", "values")
        )
        fits = rows.ndim == 1 and values.shape == (len(rows), len(KEPT))
        if not fits or factors.ndim != 2 or len(factors) != len(rows):
            raise InterpretationError(
                f"{path} is a damaged bank: rows, factors and values of {level} do not fit"
            )
