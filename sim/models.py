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
from sim.parameters.effects import effect_factors
from sim.parameters.factors import Factor
from sim.parameters.fidelity import FIDELITIES
from sim.parameters.target import ELBOW_TARGET, TARGETS
from sim.parameters.wearer import TABLE_1


@dataclass(frozen=True, kw_only=True)
class Model:
    """Something that maps named factors to named outputs."""

    name: str
    description: str
    #: Without those of effects.
    own_factors: tuple[Factor, ...]
    #: Every output a successful evaluation reports, in the order tables show them, and its unit.
    units: Mapping[str, str]
    #: Whether the parameters of effects that the nominal model lacks are factors, too.
    carries_effects: bool = False

    @property
    def factors(self) -> tuple[Factor, ...]:
        """All its factors, in the order tables show them."""
        return self.own_factors + (effect_factors() if self.carries_effects else ())

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


#: Suffixes of the regression forms, and where the local impedance is looked at.
_FORMS, _PLACES = ("", "_paper", "_authors"), ("start", "middle", "end")
_ASSESSMENT_UNITS: Mapping[str, str] = MappingProxyType(
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


class Setup(NamedTuple):
    """A model that is an assessment, with the arguments of `assess`."""

    model: Model
    target: str
    fidelity: str
    device: str


def _setup(
    name: str,
    words: str,
    *,
    target: str = "elbow",
    fidelity: str = "campaign",
    device: str = "nesm",
    effects: bool = False,
) -> Setup:
    """Return an assessment; with `effects` their parameters are factors, too."""
    contact = FIDELITIES[fidelity].contact
    conditions = tuple(f for f in CONDITIONS if contact or f.name not in CONTACT_ONLY)
    model = Model(
        name=name,
        description=f"Stiffness assessment in the exoskeleton: {words}",
        own_factors=TABLE_1 + conditions,
        units=_ASSESSMENT_UNITS,
        carries_effects=effects,
    )
    return Setup(model, target, fidelity, device)


_WITH_EFFECTS = "with effects the nominal model lacks"
ASSESSMENTS: Mapping[str, Setup] = MappingProxyType(
    {
        setup.model.name: setup
        for setup in (
            _setup("elbow", "elbow, explicit contact (paper, section 2.3)"),
            _setup(
                "elbow_bushing",
                "elbow, bushings instead of contact: milliseconds",
                fidelity="bushing",
            ),
            _setup("elbow_effects", f"elbow, explicit contact, {_WITH_EFFECTS}", effects=True),
            _setup(
                "elbow_bushing_effects",
                f"elbow, bushings, {_WITH_EFFECTS}",
                fidelity="bushing",
                effects=True,
            ),
            _setup("elbow_screening", "elbow, explicit contact, coarser", fidelity="screening"),
            _setup("elbow_reference", "elbow, explicit contact, finer", fidelity="reference"),
            _setup(
                "elbow_orthosis",
                "elbow, another device: bench-mounted, one joint",
                device="elbow_orthosis",
            ),
            _setup(
                "elbow_authors",
                "elbow, explicit contact, cuffs where the authors have them",
                device="nesm_authors",
            ),
            *(
                _setup(name, f"{name.replace('_', ' ')}, explicit contact", target=name)
                for name in TARGETS
                if name != ELBOW_TARGET.name
            ),
        )
    }
)
ELBOW = ASSESSMENTS["elbow"].model
#: Models whose factors include the parameters of undeclared effects.
WITH_EFFECTS = tuple(name for name, setup in ASSESSMENTS.items() if setup.model.carries_effects)


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


ISHIGAMI = Model(
    name="ishigami",
    description="Ishigami and Homma 1990: sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1",
    own_factors=_arguments(3, "the Ishigami function", -pi, pi, 0.0),
    units=MappingProxyType({"y": "1"}),
)
SOBOL_G = Model(
    name="sobol_g",
    description="Sobol's g-function with a = (0, 1, 4.5, 9, 99, 99): two factors do nothing",
    own_factors=_arguments(6, "Sobol's g-function", 0.0, 1.0, 0.5),
    units=MappingProxyType({"y": "1"}),
)

MODELS: Mapping[str, Model] = MappingProxyType(
    {name: setup.model for name, setup in ASSESSMENTS.items()}
    | {model.name: model for model in (ISHIGAMI, SOBOL_G)}
)
