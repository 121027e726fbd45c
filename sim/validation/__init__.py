"""The paper's two validations of its simulation, run on ours (figures 3 and 6)."""

from dataclasses import dataclass
from pathlib import Path

from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.validation.compression import (
    ELASTICITIES,
    OGNEVA_CONTRACTED,
    OGNEVA_RELAXED,
    run_compression_test,
)
from sim.validation.figures import compression_figure, isometric_figure
from sim.validation.isometric import MEASURED, run_isometric_test

#: A peak agrees with the paper's figure 3 if it lies within this share of it.
PEAK_TOLERANCE = 0.05
#: Strains at which the modulus is compared with figure 6.
STRAINS = (0.10, 0.15, 0.20)


@dataclass(frozen=True)
class Row:
    """One quantity beside the paper's."""

    quantity: str
    measured: float
    #: What the paper's figure shows, in words.
    expected: str
    unit: str
    agrees: bool


@dataclass(frozen=True, kw_only=True)
class ValidationReport:
    """Every quantity, and the pictures that show the whole curves."""

    rows: tuple[Row, ...]
    pictures: tuple[Path, ...]


def validate(directory: Path) -> ValidationReport:
    """Run both validations, write their pictures to `directory` and return the comparison.

    Raises:
        OSError: the directory cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    sets = {name: run_isometric_test(elbow=elbow) for name, elbow in ELBOW_MUSCLES.items()}
    isometric = sets["paper"]
    tests = [run_compression_test(elasticity) for elasticity in ELASTICITIES]
    rows = []
    for name, (torque, angle), expected in (
        ("flexion torque", isometric.flexion_peak, 80.0),
        ("extension torque", isometric.extension_peak, -50.0),
    ):
        first, last = sorted(data.peak_angle_deg(name.split()[0]) for data in MEASURED)
        near = abs(torque - expected) <= PEAK_TOLERANCE * abs(expected)
        around, between = f"around {expected:g} (figure 3)", f"{first:g} to {last:g}"
        rows += [
            Row(f"isometric {name}, peak", torque, around, "Nm", near),
            Row(
                f"isometric {name}, angle of peak",
                angle,
                f"{between} (both data sets of figure 3)",
                "degrees",
                first <= angle <= last,
            ),
        ]
    for strain in STRAINS:
        modulus = tests[0].modulus_at(strain)
        bound = f"at most {OGNEVA_RELAXED / 1e3:g} (figure 6, relaxed)"
        rows.append(_of_tissue("softest", strain, modulus, bound, modulus <= OGNEVA_RELAXED))
    modulus = tests[-1].modulus_at(STRAINS[0])
    bound = f"at least {OGNEVA_CONTRACTED / 1e3:g} (figure 6, contracted)"
    rows.append(_of_tissue("stiffest", STRAINS[0], modulus, bound, modulus >= OGNEVA_CONTRACTED))
    pictures = (
        isometric_figure(sets, directory / "isometric_torque.png"),
        compression_figure(tests, directory / "compression.png"),
    )
    return ValidationReport(rows=tuple(rows), pictures=pictures)


def _of_tissue(which: str, strain: float, modulus: float, expected: str, agrees: bool) -> Row:
    """Return the row of a tissue's modulus (Pa)."""
    quantity = f"Young's modulus of the {which} tissue at {strain:.0%} strain"
    return Row(quantity, modulus / 1e3, expected, "kPa", agrees)
