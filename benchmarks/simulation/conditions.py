"""What each condition, alone, does to the error of the nominal wearer, and how an arm is held.

`python -m benchmarks.simulation.conditions`
"""

from collections.abc import Mapping, Sequence
from multiprocessing import get_context
from typing import NamedTuple

from benchmarks.machine import describe_machine
from sim.assessment.assess import assess
from sim.parameters.conditions import CONDITIONS, TISSUE_COUPLING
from sim.parameters.wearer import NOMINAL, TABLE_1
from sim.robot.device import NESM
from sim.validation.compression import ELASTICITIES, run_compression_test

SOFTNESS = "upper_arm_elasticity"
#: N/m: Table 1's lowest, two between, nominal and highest.
ELASTICITIES_N_M = (100.5, 200.0, 320.0, NOMINAL[SOFTNESS], 974.43)
#: The last one is the authors', MuJoCo's own default.
FRICTIONS = (0.1, 0.3, 0.5, 0.8, 1.0)
COUPLINGS = (1.0, 0.5, 0.2, TISSUE_COUPLING, 0.11, 0.0)
#: Conditions that show only beside another value.
BESIDE = {
    "reflex_threshold": {"reflex_gain": 0.2},
    "reflex_delay": {"reflex_gain": 0.2},
}


class Job(NamedTuple):
    """One assessment."""

    values: Mapping[str, float]
    fidelity: str = "campaign"
    device: str = NESM.name


def run(job: Job) -> str:
    """Return the error of an assessment in Nm/rad, or the name of its failure."""
    found = assess(job.values, fidelity=job.fidelity, device=job.device)
    return f"{found.outputs['stiffness_error']:.2f}" if found.outputs else found.outcome


def alone() -> list[tuple[str, Job]]:
    """Return the ends of every condition's range, each with its label."""
    jobs = []
    for factor in CONDITIONS:
        beside = BESIDE.get(factor.name, {})
        label = "".join(f", {name} {value:g}" for name, value in beside.items())
        for value in (factor.low, factor.high):
            jobs.append((f"{factor.name} {value:g}{label}", Job({**beside, factor.name: value})))
    return jobs


def softness() -> list[tuple[str, list[Job]]]:
    """Return rows over the upper arm's elasticity: at several frictions, lengths, fidelities."""
    length = next(factor for factor in TABLE_1 if factor.name == "upper_arm_length")
    rows = [
        (f"cuff_friction {friction:g}", Job({"cuff_friction": friction})) for friction in FRICTIONS
    ]
    rows += [
        (f"{fidelity}, {length.name} {value:g}", Job({length.name: value}, fidelity))
        for value in (length.low, length.nominal, length.high)
        for fidelity in ("campaign", "bushing")
    ]
    return [
        (label, [job._replace(values={**job.values, SOFTNESS: n}) for n in ELASTICITIES_N_M])
        for label, job in rows
    ]


def moduli(coupling: float) -> Sequence[float]:
    """Return Young's modulus of the softest at 20 % strain and of the stiffest at 10 %, kPa."""
    softest, *_, stiffest = (run_compression_test(n, coupling=coupling) for n in ELASTICITIES)
    return softest.modulus_at(0.2) / 1e3, stiffest.modulus_at(0.1) / 1e3


def main() -> None:
    print(describe_machine())
    singles, rows = alone(), softness()
    coupled = [Job({"tissue_coupling": coupling}) for coupling in COUPLINGS]
    orthosis = Job({}, device="elbow_orthosis")
    jobs = [Job({}), *(job for _, job in singles), *(job for _, row in rows for job in row)]
    with get_context("spawn").Pool(2) as pool:
        found = iter(pool.map(run, [*jobs, *coupled], chunksize=1))
        pressed = pool.map(moduli, COUPLINGS, chunksize=1)
    print(f"\nstiffness_error, Nm/rad; nominal wearer {next(found)}; one condition changed")
    for label, _ in singles:
        print(f"  {label:46s} {next(found):>8s}")
    print(f"\nstiffness_error over {SOFTNESS}, N/m")
    print(f"  {'':34s}" + "".join(f"{n:9.1f}" for n in ELASTICITIES_N_M))
    for label, row in rows:
        print(f"  {label:34s}" + "".join(f"{next(found):>9s}" for _ in row))
    print("\ntissue_coupling   softest at 20 %   stiffest at 10 % strain   stiffness_error")
    for coupling, (soft, stiff) in zip(COUPLINGS, pressed, strict=True):
        print(f"  {coupling:<14g} {soft:10.1f} kPa {stiff:20.0f} kPa {next(found):>20s}")
    outputs = assess(orthosis.values, device=orthosis.device).outputs
    print(f"\n{orthosis.device}, nominal wearer, Nm/rad")
    for name in ("stiffness_true", "stiffness_estimate", "stiffness_error"):
        print(f"  {name:20s} {outputs[name]:6.2f}")


if __name__ == "__main__":
    main()
