"""Moment arms of the elbow's muscles over its angle, beside those measured."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from sim.body.muscles.lengths import SWEEP, elbow_lengths
from sim.body.muscles.muscle import ElbowMuscles
from sim.parameters.wearer import NOMINAL_WEARER

#: Pigeon, Yahia and Feldman 1996: moment arm in mm, a polynomial of the elbow's flexion in degrees,
#: highest power first; positive flexes.
PIGEON: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "biceps": (-2.9883e-5, 1.8047e-3, 4.5322e-1, 14.660),
        "brachialis": (-2.0530e-5, 2.3425e-3, 2.3080e-1, 5.5492),
        "brachioradialis": (-6.5171e-5, 1.0084e-2, 1.6681e-1, 19.490),
        "triceps": (-3.5171e-9, 1.3277e-6, -1.9092e-4, 1.2886e-2, -3.0284e-1, -23.287),
    }
)
#: Sugisaki et al. 2010, by magnetic resonance imaging of 18 living people: mean and standard
#: deviation of the triceps' moment arm, mm, by the elbow's flexion in degrees; it extends.
SUGISAKI: Mapping[int, tuple[float, float]] = MappingProxyType(
    {30: (-23.9, 1.4), 110: (-17.4, 1.3)}
)
#: Angles of an assessment's movement, degrees.
ANGLES_DEG = np.arange(10.0, 111.0)


def measured_mm(muscle: str) -> np.ndarray:
    """Return the measured moment arm of a muscle of PIGEON over ANGLES_DEG, mm."""
    return np.polyval(PIGEON[muscle], ANGLES_DEG)


def moment_arms_mm(elbow: ElbowMuscles) -> dict[str, np.ndarray]:
    """Return the moment arm of each muscle of PIGEON over ANGLES_DEG, mm; positive flexes.

    The wearer is nominal. It is what a muscle shortens by as the elbow flexes (An et al. 1984), and
    of several heads their mean.
    """
    lengths = elbow_lengths(NOMINAL_WEARER, elbow)
    arms = {}
    for muscle in PIGEON:
        heads = [-np.gradient(lengths[name], SWEEP) for name in lengths if name.startswith(muscle)]
        arms[muscle] = 1e3 * np.interp(np.radians(ANGLES_DEG), SWEEP, np.mean(heads, axis=0))
    return arms
