"""What skin and muscle tolerate, beside what cuffs and straps do to them in an assessment."""

from collections.abc import Mapping
from dataclasses import dataclass

from sim.assessment.skin import LIMBS


@dataclass(frozen=True, kw_only=True)
class Tolerable:
    """The most that was tolerated of one quantity, and by whom."""

    #: The output without its limb.
    quantity: str
    limit: float
    unit: str
    source: str


#: Nothing was measured under the cuffs of an arm that is moved for six seconds. These are the
#: nearest: a pad pressed on until it hurts, and what closes vessels or kills cells in an hour.
TOLERABLE = (
    Tolerable(
        quantity="mean_pressure",
        limit=11.6,
        unit="kPa",
        source="skin without oxygen at the sacrum, Goossens et al. 1994",
    ),
    Tolerable(
        quantity="peak_pressure",
        limit=17.3,
        unit="kPa",
        source="pain under 20 cm2 on women's thighs, Kozinc et al. 2021; men's: 44.7",
    ),
    Tolerable(
        quantity="mean_shear",
        limit=3.1,
        unit="kPa",
        source="lowers that pressure to 8.7 kPa, Goossens et al. 1994",
    ),
    Tolerable(
        quantity="tissue_strain",
        limit=0.65,
        unit="1",
        source="muscle cells live for an hour, Gefen et al. 2008",
    ),
)


def beside(outputs: Mapping[str, float]) -> list[tuple[str, float, Tolerable]]:
    """Return each quantity of both limbs: in words, its value, and what is tolerable.

    `outputs` are those of an assessment with contact.
    """
    return [
        (
            f"{tolerable.quantity} under the {limb}'s cuff".replace("_", " "),
            outputs[f"{tolerable.quantity}_{limb}"],
            tolerable,
        )
        for tolerable in TOLERABLE
        for limb in LIMBS
    ]
