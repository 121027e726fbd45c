"""The models a worker can evaluate: their factors and their outputs.

Nothing here imports MuJoCo, so that a coordinator can describe a study without being able to run
it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from types import MappingProxyType
from typing import NamedTuple

from sim.parameters.conditions import CONDITIONS, CONTACT_ONLY
from sim.parameters.effects import EFFECT_FACTORS
from sim.parameters.factors import Factor
from sim.parameters.wearer import TABLE_1


@dataclass(frozen=True, kw_only=True)
class Model:
    """Something that maps named factors to named outputs."""

    name: str
    description: str
    factors: tuple[Factor, ...]
    #: Every output a successful evaluation reports, in the order tables show them, and its unit.
    units: Mapping[str, str]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.units)

    @property
    def sampled(self) -> tuple[Factor, ...]:
        """The factors a study samples unless it says otherwise."""
        return tuple(factor for factor in self.factors if not factor.optional)

    def factor(self, name: str) -> Factor:
        """Return the factor called `name`; KeyError if the model has none."""
        for factor in self.factors:
            if factor.name == name:
                return factor
        raise KeyError(name)


_ASSESSMENT_UNITS: Mapping[str, str] = MappingProxyType(
    {
        f"stiffness_{quantity}{form}": "Nm/rad"
        for form in ("", "_paper", "_authors")
        for quantity in ("error", "estimate", "true")
    }
    | {
        "damping_estimate": "Nm s/rad",
        "peak_contact_force": "N",
        "tracking_rmse": "rad",
    }
)


def _assessment(name: str, description: str, conditions: tuple[Factor, ...] = CONDITIONS) -> Model:
    return Model(
        name=name,
        description=f"Stiffness assessment in the exoskeleton: {description}",
        factors=TABLE_1 + conditions,
        units=_ASSESSMENT_UNITS,
    )


ELBOW = _assessment("elbow", "elbow, explicit contact (paper, section 2.3)")
_BUSHING_CONDITIONS = tuple(factor for factor in CONDITIONS if factor.name not in CONTACT_ONLY)
ELBOW_BUSHING = _assessment(
    "elbow_bushing", "elbow, bushings instead of contact: milliseconds", _BUSHING_CONDITIONS
)
ELBOW_EFFECTS = _assessment(
    "elbow_effects",
    "elbow, explicit contact, with effects the nominal model lacks",
    CONDITIONS + EFFECT_FACTORS,
)
ELBOW_BUSHING_EFFECTS = _assessment(
    "elbow_bushing_effects",
    "elbow, bushings, with effects the nominal model lacks",
    _BUSHING_CONDITIONS + EFFECT_FACTORS,
)
#: Models whose factors include the parameters of undeclared effects.
WITH_EFFECTS = (ELBOW_EFFECTS.name, ELBOW_BUSHING_EFFECTS.name)


class Setup(NamedTuple):
    """A model that is an assessment, with the arguments of `assess`."""

    model: Model
    target: str = "elbow"
    fidelity: str = "campaign"
    device: str = "nesm"


ASSESSMENTS: Mapping[str, Setup] = MappingProxyType(
    {
        setup.model.name: setup
        for setup in (
            Setup(ELBOW),
            Setup(ELBOW_BUSHING, fidelity="bushing"),
            Setup(ELBOW_EFFECTS),
            Setup(ELBOW_BUSHING_EFFECTS, fidelity="bushing"),
            Setup(
                _assessment("elbow_screening", "elbow, explicit contact, coarser"),
                fidelity="screening",
            ),
            Setup(
                _assessment("elbow_reference", "elbow, explicit contact, finer"),
                fidelity="reference",
            ),
            Setup(
                _assessment("elbow_orthosis", "elbow, another device: bench-mounted, one joint"),
                device="elbow_orthosis",
            ),
            *(
                Setup(_assessment(name, f"{name.replace('_', ' ')}, explicit contact"), name)
                for name in ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation")
            ),
        )
    }
)

ISHIGAMI = Model(
    name="ishigami",
    description="Ishigami and Homma 1990: sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1",
    factors=tuple(
        Factor(
            name=f"x{i}",
            unit="1",
            low=-pi,
            high=pi,
            nominal=0.0,
            description=f"argument {i} of the Ishigami function",
        )
        for i in (1, 2, 3)
    ),
    units=MappingProxyType({"y": "1"}),
)

SOBOL_G = Model(
    name="sobol_g",
    description="Sobol's g-function with a = (0, 1, 4.5, 9, 99, 99): two factors do nothing",
    factors=tuple(
        Factor(
            name=f"x{i}",
            unit="1",
            low=0.0,
            high=1.0,
            nominal=0.5,
            description=f"argument {i} of Sobol's g-function",
        )
        for i in range(1, 7)
    ),
    units=MappingProxyType({"y": "1"}),
)

MODELS: Mapping[str, Model] = MappingProxyType(
    {name: setup.model for name, setup in ASSESSMENTS.items()}
    | {model.name: model for model in (ISHIGAMI, SOBOL_G)}
)
