"""The paper's two validations of its simulation, run on ours (figures 3 and 6)."""

from dataclasses import dataclass
from pathlib import Path

from sim.body.muscles.elbow import PAPER_MUSCLES
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


@dataclass(frozen=True, kw_only=True)
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
    isometric = run_isometric_test()
    tests = [run_compression_test(elasticity) for elasticity in ELASTICITIES]
    rows = []
    for name, (torque, angle), expected in (
        ("flexion torque", isometric.flexion_peak, 80.0),
        ("extension torque", isometric.extension_peak, -50.0),
    ):
        first, last = sorted(data.peak_angle_deg(name.split()[0]) for data in MEASURED)
        rows.append(
            Row(
                quantity=f"isometric {name}, peak",
                measured=torque,
                expected=f"around {expected:g} (figure 3)",
                unit="Nm",
                agrees=abs(torque - expected) <= PEAK_TOLERANCE * abs(expected),
            )
        )
        rows.append(
            Row(
                quantity=f"isometric {name}, angle of peak",
                measured=angle,
                expected=f"{first:g} to {last:g} (both data sets of figure 3)",
                unit="degrees",
                agrees=first <= angle <= last,
            )
        )
    softest, stiffest = tests[0], tests[-1]
    for strain in STRAINS:
        modulus = softest.modulus_at(strain)
        rows.append(
            Row(
                quantity=f"Young's modulus of the softest tissue at {strain:.0%} strain",
                measured=modulus / 1e3,
                expected=f"at most {OGNEVA_RELAXED / 1e3:g} (figure 6, relaxed)",
                unit="kPa",
                agrees=modulus <= OGNEVA_RELAXED,
            )
        )
    modulus = stiffest.modulus_at(STRAINS[0])
    rows.append(
        Row(
            quantity=f"Young's modulus of the stiffest tissue at {STRAINS[0]:.0%} strain",
            measured=modulus / 1e3,
            expected=f"at least {OGNEVA_CONTRACTED / 1e3:g} (figure 6, contracted)",
            unit="kPa",
            agrees=modulus >= OGNEVA_CONTRACTED,
        )
    )
    papers = run_isometric_test(elbow=PAPER_MUSCLES)
    pictures = (
        isometric_figure(isometric, papers, directory / "isometric_torque.png"),
        compression_figure(tests, directory / "compression.png"),
    )
    return ValidationReport(rows=tuple(rows), pictures=pictures)
