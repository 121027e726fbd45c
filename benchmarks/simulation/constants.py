"""Every constant of ours or others that the arm is held by, with what it does to the error.

`python -m benchmarks.simulation.constants [FIDELITY]`: each is moved alone to the ends of its
uncertainty, the wearer nominal and what the robot declares unchanged. The table says where its
value is from, and what it was chosen by.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import NamedTuple

from benchmarks.machine import describe_machine
from sim.assessment.assess import assess
from sim.parameters.conditions import CONDITIONS
from sim.parameters.fidelity import CAMPAIGN


class Constant(NamedTuple):
    """A constant of a module of `sim`, or a condition."""

    name: str
    low: float
    high: float
    source: str
    chosen_by: str


CONSTANTS = (
    Constant("activation", 0.3, 0.5, "authors' code", "theirs"),
    Constant("cuff_friction", 0.31, 0.61, "Zhang and Mak 1999", "skin on five materials"),
    Constant("strap_tension", 15.0, 60.0, "ours", "the arm stays in its cuffs"),
    Constant("tissue_coupling", 0.0, 1.0, "ours", "moduli of figure 6"),
    Constant("extension_stop", 0.0, 60.0, "ours", "long heavy arms do not hyperextend"),
    Constant("upper_cuff_position", -0.048, 0.0, "ours", "an index: softness matters little"),
    Constant("cuff_position", -0.03, 0.0, "ours", "an index: softness matters little"),
    Constant("elbow_offset", -0.0042, 0.0042, "alignment", "nominal means aligned"),
    Constant("STRAP_STIFFNESS", 5e3, 2e4, "ours", "valid corners of Table 1"),
    Constant("STRAP_MASS", 0.02, 0.2, "ours", "a textile strap's weight"),
    Constant("PARTICLE_DAMPING", 10.0, 40.0, "ours", "numerical: nothing rings"),
    Constant("CUFF_THICKNESS", 0.02, 0.04, "ours", "numerical: nothing passes through"),
    Constant("ELEMENT_RADIUS", 0.018, 0.028, "ours", "numerical: no edge catches"),
    Constant("ELEMENT_INERTIA", 2.0, 8.0, "ours", "numerical: step times viscosity"),
    Constant("VISCOSITY", 50.0, 200.0, "authors' code (111)", "theirs, rounded"),
    Constant("HARDENING", 0.008, 0.018, "ours", "moduli of figure 6"),
    Constant("BONE_CLEARANCE", 0.008, 0.016, "ours", "thin arms keep their bones"),
    Constant("UPPER_ARM_START", 0.07, 0.1, "ours", "tissue covers the cuff"),
    Constant("JOINT_DAMPING", 0.3, 1.2, "authors' code", "theirs"),
    Constant("STOP_ANGLE", 0.0, 0.17, "ours", "ligaments tighten near extension"),
    Constant("HOLD", 1.2, 2.5, "ours", "corners of Table 1 are at rest"),
)


@contextmanager
def moved(name: str, value: float) -> Iterator[dict[str, float]]:
    """Within the block, have a constant's value wherever it is used; yield the conditions."""
    if name in {factor.name for factor in CONDITIONS}:
        yield {name: value}
        return
    homes = _homes(name)
    kept = getattr(homes[0], name)
    for home in homes:
        setattr(home, name, value)
    try:
        yield {}
    finally:
        for home in homes:
            setattr(home, name, kept)


def held(name: str) -> float:
    """Return a constant's value."""
    own = {factor.name: factor.nominal for factor in CONDITIONS}
    if name in own:
        return own[name]
    return float(getattr(_homes(name)[0], name))


def _homes(name: str) -> list[ModuleType]:
    """Return the modules of `sim` that know a constant.

    Raises:
        LookupError: there is none, or they mean different things by that name.
    """
    homes = [m for n, m in sys.modules.items() if n.startswith("sim.") and hasattr(m, name)]
    if len({getattr(home, name) for home in homes}) != 1:
        raise LookupError(f"{name} is not one constant: {[home.__name__ for home in homes]}")
    return homes


def main(fidelity: str) -> None:
    print(describe_machine())
    nominal = assess({}, fidelity=fidelity).outputs["stiffness_error"]
    print(f"\nstiffness_error of the nominal wearer at {fidelity}: {nominal:.2f} Nm/rad")
    print("  constant             value     moved to          error moves by     source; chosen by")
    for constant in CONSTANTS:
        found = []
        for value in (constant.low, constant.high):
            with moved(constant.name, value) as conditions:
                outcome = assess(conditions, fidelity=fidelity)
            error = outcome.outputs.get("stiffness_error")
            found.append(outcome.outcome if error is None else f"{error - nominal:+.2f}")
        print(
            f"  {constant.name:20s} {held(constant.name):<8g}  "
            f"{constant.low:g} to {constant.high:g}".ljust(50)
            + f"{found[0]:>7s} {found[1]:>7s}     {constant.source}; {constant.chosen_by}",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else CAMPAIGN.name)
