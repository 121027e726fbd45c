"""How finely cuffs, straps and tissue are divided: the same arm, at four prices.

`docs/measurements/fidelities.md` has the convergence study behind these.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType


@dataclass(frozen=True, kw_only=True)
class Fidelity:
    """A discretisation of the interface."""

    name: str
    #: Time step, s; a contact's time constant is never below two steps.
    step: float
    #: Tissue elements along and around a limb.
    rings: int
    per_ring: int
    #: Strap particles along the limb and across it.
    strap_rows: int
    strap_across: int
    #: Inertia of a strap particle's slides, kg: step^2 x segment stiffness must stay below it.
    particle_inertia: float
    #: Stiffness of friction over that of the normal: where it is low a limb creeps under load.
    impratio: float = 5.0
    #: Impedance (0 to 1) of a contact that begins, and the depth at which it has grown to 0.99, m:
    #: contacts that begin abruptly make stiffness jump where they do so a step earlier or later.
    onset: tuple[float, float] = (0.7, 0.0005)
    #: Whether friction is bounded by pyramids instead of elliptic cones.
    pyramids: bool = False
    #: Whether tissue, cuffs and straps meet in explicit contact; if not, bushings join them
    #: (`sim.interface.bushing`), and of the divisions above only validity looks at the tissue's.
    contact: bool = True


CAMPAIGN = Fidelity(
    name="campaign",
    step=0.015,
    rings=12,
    per_ring=8,
    strap_rows=3,
    strap_across=6,
    particle_inertia=9.0,
)
BUSHING = replace(CAMPAIGN, name="bushing", step=0.01, contact=False)
SCREENING = replace(
    CAMPAIGN, name="screening", step=0.0125, rings=8, strap_rows=1, particle_inertia=12.0
)
REFERENCE = replace(
    CAMPAIGN,
    name="reference",
    step=0.005,
    per_ring=12,
    strap_across=8,
    particle_inertia=10.0,
    impratio=20.0,
    onset=(0.95, 0.002),
)
FIDELITIES: Mapping[str, Fidelity] = MappingProxyType(
    {fidelity.name: fidelity for fidelity in (BUSHING, SCREENING, CAMPAIGN, REFERENCE)}
)


def fidelity_of(choice: str | Fidelity) -> Fidelity:
    """Return the fidelity of a name, or `choice` itself; ValueError if the name is unknown."""
    if isinstance(choice, Fidelity):
        return choice
    if choice not in FIDELITIES:
        known = ", ".join(FIDELITIES)
        raise ValueError(f"unknown fidelity {choice!r}: expected one of {known}")
    return FIDELITIES[choice]
