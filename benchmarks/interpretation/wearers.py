"""Wearers of a population with contact: what their robots record whole, and the truth."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np

from analysis.interpretation.bank.bank import KEPT, Samples
from analysis.interpretation.bank.population import Population
from analysis.interpretation.bank.sampling import parameters_of
from analysis.interpretation.recording import Recording
from sim.assessment.assess import assess
from sim.assessment.donning import close_straps
from sim.assessment.summary import Motion, motion_of, summary_of
from sim.parameters.conditions import split
from sim.parameters.fidelity import CAMPAIGN
from sim.robot.device import NESM
from sim.system.system import System

#: Joints of the device.
JOINTS = 4
#: Seed of wearers whom neither a bank nor any choice has seen.
FRESH = 7141
_FIDELITIES = {"contact": CAMPAIGN.name, "bushing": "bushing"}


@dataclass(frozen=True, kw_only=True)
class Wearers:
    """Wearers whose assessment could be believed, and their recordings."""

    samples: Samples
    #: Time, angles, velocities and motor torques of each, shape (wearers, samples, 1 + 3 * JOINTS).
    recorded: np.ndarray

    def __len__(self) -> int:
        return len(self.samples)

    def some(self, chosen: np.ndarray) -> "Wearers":
        """Return the wearers that `chosen` (indices or a mask) says."""
        return Wearers(samples=self.samples.some(chosen), recorded=self.recorded[chosen])

    def recordings(self, zero_errors: np.ndarray) -> Iterator[Recording]:
        """Yield what robots record whose torques have `zero_errors` (wearers, JOINTS), Nm."""
        for row, table, zero in zip(self.samples.rows, self.recorded, zero_errors, strict=True):
            theta, velocity, torque = np.split(table[:, 1:], 3, axis=1)
            motion = Motion(
                time=table[:, 0],
                theta=theta,
                velocity=velocity,
                torque=torque + zero,
                joint=JOINTS - 1,
            )
            yield Recording(source=f"wearer {row}", device=NESM.name, motion=motion)


def simulated(
    population: Population,
    seed: int,
    rows: Sequence[int],
    *,
    changed: Mapping[str, float] | None = None,
    keep: Path | None = None,
    device: str = NESM.name,
    level: str = "contact",
) -> Wearers:
    """Return wearers `rows` of `seed`, from a file of the folder `keep` if they were kept.

    Args:
        population: whom they belong to.
        seed: of the population's draw.
        rows: their numbers.
        changed: values of factors that replace what was drawn.
        keep: where what was simulated is kept.
        device: a name or a path, with as many driven joints as the NESM.
        level: "contact" or "bushing".
    """
    worn = "" if device == NESM.name else f"-{Path(device).stem}"
    worn += "" if level == "contact" else f"-{level}"
    path = keep / f"{seed}-{len(rows)}{worn}.npz" if keep else None
    if path is not None and path.exists():
        with np.load(path, allow_pickle=False) as file:
            own = {name: file[name] for name in ("rows", "factors", "values", "recorded")}
            failed = json.loads(str(file["failed"]))
        recorded = own.pop("recorded")
        return Wearers(samples=Samples(**own, failed=failed), recorded=recorded)
    factors = population.draw(seed, np.asarray(rows))
    chosen, values, recorded, failed = [], [], [], Counter[str]()
    for i, drawn in enumerate(factors):
        parameters = parameters_of(population, drawn, level) | dict(changed or {})
        found = assess(parameters, device=device, fidelity=_FIDELITIES[level])
        if found.outcome != "ok" or found.record is None:
            failed[found.outcome] += 1
            continue
        outputs = dict(found.outputs) | summary_of(found.record, split(parameters)[1])
        motion = motion_of(found.record)
        chosen.append(i)
        values.append([outputs.get(name, np.nan) for name in KEPT])
        channels = (motion.time, motion.theta, motion.velocity, motion.torque)
        recorded.append(np.column_stack(channels))
    samples = Samples(
        rows=np.asarray(rows, dtype=np.int64)[chosen],
        factors=factors[chosen],
        values=np.array(values).reshape(-1, len(KEPT)),
        failed=dict(sorted(failed.items())),
    )
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(
            path,
            rows=samples.rows,
            factors=samples.factors,
            values=samples.values,
            recorded=np.array(recorded),
            failed=np.array(json.dumps(samples.failed)),
        )
    return Wearers(samples=samples, recorded=np.array(recorded))


@contextmanager
def strap_cut(limb: int) -> Iterator[None]:
    """Cut the straps of the upper arm (0) or of the forearm (1) once they are closed.

    No detector judges how the arm is held: a robot in a clinic has none, and records on.
    """

    def close(system: System, data: mujoco.MjData, stiffness: np.ndarray) -> None:
        close_straps(system, data, stiffness)
        system.model.tendon_stiffness[np.split(system.straps, 2)[limb]] = 0.0

    with (
        mock.patch("sim.assessment.donning.close_straps", close),
        mock.patch("sim.assessment.validity.HOLD_BOUNDS", ()),
    ):
        yield
