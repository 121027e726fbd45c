"""The models that come with rehyb: their factors and their outputs.

Nothing here imports MuJoCo, so that who cannot run them can describe them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from math import pi
from types import MappingProxyType
from typing import Any

from models.description import Description, Kind, Output
from models.factors import Factor
from sim.parameters.conditions import CONDITIONS, CONTACT_ONLY
from sim.parameters.curves import OVER_PHASE, UNITS
from sim.parameters.effects import effect_factors
from sim.parameters.fidelity import FIDELITIES
from sim.parameters.target import ELBOW_TARGET, TARGETS
from sim.parameters.wearer import TABLE_1

#: Suffixes of the regression forms, and where the local impedance is looked at.
_FORMS, _PLACES = ("", "_paper", "_authors"), ("start", "middle", "end")
_UNITS: Mapping[str, str] = MappingProxyType(
    {
        f"stiffness_{quantity}{form}": "Nm/rad"
        for form in _FORMS
        for quantity in ("error", "estimate", "true")
    }
    | {"damping_estimate": "Nm s/rad", "peak_contact_force": "N", "tracking_rmse": "rad"}
    | {f"stiffness_true_r2{form}": "1" for form in _FORMS}
    | {
        f"stiffness_{part}{quantity}": unit
        for part in ("passive", "sum")
        for quantity, unit in (("", "Nm/rad"), ("_r2", "1"))
    }
    | {f"local_stiffness_{place}": "Nm/rad" for place in _PLACES}
    | {f"local_damping_{place}": "Nm s/rad" for place in _PLACES}
    | {"shoulder_to_elbow": "m", "elbow_to_wrist": "m"}
)
#: A recording in windows (`sim.assessment.summary`): the elbow's angle, then the torque about each
#: of the NESM's joints that its declared model does not explain; and what regressions make of it.
WINDOWS = 18
CURVES = tuple(
    f"{curve}_{window:02d}"
    for curve in ("angle", *(f"torque_J{joint}" for joint in range(1, 5)))
    for window in range(WINDOWS)
)
ESTIMATES = ("affine_stiffness", "affine_damping", "paper_stiffness", "paper_damping", "residual")
#: K_h and D_h of the whole elbow in the restoring sense, and K_h by equation 21.
TRUTHS = ("true_stiffness", "true_damping", "true_stiffness_paper")
_RECORDED: Mapping[str, str] = MappingProxyType(
    {name: "rad" if name.startswith("angle") else "Nm" for name in CURVES}
    | dict(zip(ESTIMATES, ("Nm/rad", "Nm s/rad", "Nm/rad", "Nm s/rad", "Nm"), strict=True))
    | dict(zip(TRUTHS, ("Nm/rad", "Nm s/rad", "Nm/rad"), strict=True))
)
#: What only elements of tissue can tell (`docs/understand/skin.md`).
_OF_SKIN: Mapping[str, str] = MappingProxyType(
    {
        name: unit
        for limb in ("upper_arm", "forearm")
        for name, unit in (
            (f"peak_pressure_{limb}", "kPa"),
            (f"mean_pressure_{limb}", "kPa"),
            (f"peak_shear_{limb}", "kPa"),
            (f"mean_shear_{limb}", "kPa"),
            (f"tissue_strain_{limb}", "1"),
        )
    }
)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A model that is an assessment: the arguments of `assess`."""

    name: str
    description: str
    target: str = "elbow"
    fidelity: str = "campaign"
    device: str = "nesm"
    #: Whether the parameters of effects that the nominal model lacks are factors, too.
    carries_effects: bool = False
    #: Whether what a robot records is among the results (`sim.assessment.summary`).
    records: bool = False

    @property
    def setting(self) -> dict[str, Any]:
        """What `assess` takes besides factors and curves."""
        return {"target": self.target, "fidelity": self.fidelity, "device": self.device}

    def describe(self) -> Description:
        """Return what a study needs to know; with effects, this loads NumPy."""
        contact = FIDELITIES[self.fidelity].contact
        conditions = tuple(f for f in CONDITIONS if contact or f.name not in CONTACT_ONLY)
        units = {
            **_UNITS,
            **(_OF_SKIN if contact else {}),
            **(_RECORDED if self.records else {}),
        }
        return Description(
            name=self.name,
            description=f"Stiffness assessment in the exoskeleton: {self.description}",
            kind=Kind.PYTHON,
            factors=TABLE_1 + conditions + (effect_factors() if self.carries_effects else ()),
            results=(
                *(Output(name=name, unit=unit) for name, unit in units.items()),
                *(
                    Output(name=name, unit=UNITS[name], curve=c.points, over=c.over, optional=True)
                    for name, c in OVER_PHASE.items()
                ),
            ),
        )


_WITH_EFFECTS = "with effects the nominal model lacks"
ASSESSMENTS: Mapping[str, Setup] = MappingProxyType(
    {
        setup.name: setup
        for setup in (
            Setup(name="elbow", description="elbow, explicit contact (paper, section 2.3)"),
            Setup(
                name="elbow_bushing",
                description="elbow, bushings instead of contact: milliseconds",
                fidelity="bushing",
            ),
            Setup(
                name="elbow_effects",
                description=f"elbow, explicit contact, {_WITH_EFFECTS}",
                carries_effects=True,
            ),
            Setup(
                name="elbow_bushing_effects",
                description=f"elbow, bushings, {_WITH_EFFECTS}",
                fidelity="bushing",
                carries_effects=True,
            ),
            Setup(
                name="elbow_recording",
                description="elbow, explicit contact, with what the robot records",
                carries_effects=True,
                records=True,
            ),
            Setup(
                name="elbow_bushing_recording",
                description="elbow, bushings, with what the robot records",
                fidelity="bushing",
                carries_effects=True,
                records=True,
            ),
            Setup(
                name="elbow_screening",
                description="elbow, explicit contact, coarser",
                fidelity="screening",
            ),
            Setup(
                name="elbow_reference",
                description="elbow, explicit contact, finer",
                fidelity="reference",
            ),
            Setup(
                name="elbow_orthosis",
                description="elbow, another device: bench-mounted, one joint",
                device="elbow_orthosis",
            ),
            Setup(
                name="elbow_authors",
                description="elbow, explicit contact, cuffs where the authors have them",
                device="nesm_authors",
            ),
            Setup(
                name="elbow_passive",
                description="elbow, explicit contact, passive joints align the robot's elbow",
                device="nesm_passive",
            ),
            *(
                Setup(
                    name=name,
                    description=f"{name.replace('_', ' ')}, explicit contact",
                    target=name,
                )
                for name in TARGETS
                if name != ELBOW_TARGET.name
            ),
        )
    }
)
#: Models whose factors include the parameters of undeclared effects.
WITH_EFFECTS = tuple(name for name, setup in ASSESSMENTS.items() if setup.carries_effects)


def _arguments(count: int, of: str, low: float, high: float, nominal: float) -> tuple[Factor, ...]:
    """Return x1, x2, ... of a test function."""
    return tuple(
        Factor(
            name=f"x{i}",
            unit="1",
            low=low,
            high=high,
            nominal=nominal,
            description=f"argument {i} of {of}",
        )
        for i in range(1, count + 1)
    )


ISHIGAMI = Description(
    name="ishigami",
    description="Ishigami and Homma 1990: sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1",
    kind=Kind.PYTHON,
    factors=_arguments(3, "the Ishigami function", -pi, pi, 0.0),
    results=(Output(name="y", unit="1"),),
)
SOBOL_G = Description(
    name="sobol_g",
    description="Sobol's g-function with a = (0, 1, 4.5, 9, 99, 99): two factors do nothing",
    kind=Kind.PYTHON,
    factors=_arguments(6, "Sobol's g-function", 0.0, 1.0, 0.5),
    results=(Output(name="y", unit="1"),),
)


_CLOSED_FORMS = MappingProxyType({model.name: model for model in (ISHIGAMI, SOBOL_G)})


@cache
def _described(name: str) -> Description:
    return _CLOSED_FORMS[name] if name in _CLOSED_FORMS else ASSESSMENTS[name].describe()


class _BuiltIn(Mapping[str, Description]):
    """Descriptions by name, each made when it is asked for: effects load NumPy."""

    def __getitem__(self, name: str) -> Description:
        return _described(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*ASSESSMENTS, *_CLOSED_FORMS))

    def __len__(self) -> int:
        return len(ASSESSMENTS) + len(_CLOSED_FORMS)

    def __contains__(self, name: object) -> bool:
        return name in ASSESSMENTS or name in _CLOSED_FORMS


MODELS: Mapping[str, Description] = _BuiltIn()
ELBOW = MODELS["elbow"]
