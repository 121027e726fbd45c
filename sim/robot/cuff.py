"""Where a device has a cuff, and how large it is."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, sin

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Cuff:
    """One semi-cylindrical cuff with its strap, in the frame of the link that carries it, in m."""

    name: str
    link: str
    centre: tuple[float, float, float]
    #: Unit vectors: along the limb (distal), and out of the opening (medial).
    along: tuple[float, float, float]
    opening: tuple[float, float, float]
    length: float
    radius: float
    #: Where the device has the limb's joint: along and across the upper arm, from the shoulder.
    limb_joint: tuple[float, float]
    #: The centre from that joint while the arm is straight: along the limb, out of the opening,
    #: towards the upper wall.
    limb_place: tuple[float, float, float]

    @cached_property
    def wall(self) -> np.ndarray:
        """Unit vector towards the upper wall: along x opening."""
        (x, y, z), (u, v, w) = self.along, self.opening
        return np.array([y * w - z * v, z * u - x * w, x * v - y * u])

    @cached_property
    def axes(self) -> np.ndarray:
        """Along the limb, out of the opening, towards the wall: columns in the link, (3, 3)."""
        return np.column_stack([self.along, self.opening, self.wall])

    def normal(self, angle: float) -> np.ndarray:
        """Unit vector out of the cuff's axis, `angle` rad from the opening to the upper wall."""
        return cos(angle) * np.array(self.opening, dtype=float) + sin(angle) * self.wall

    def box_frame(self, angle: float) -> np.ndarray:
        """Return a right-handed frame, columns tangent, normal, along, shape (3, 3)."""
        tangent = sin(angle) * np.array(self.opening, dtype=float) - cos(angle) * self.wall
        return np.column_stack([tangent, self.normal(angle), self.along])

    def moved(self, distance: float) -> "Cuff":
        """Return the cuff moved along its limb, distally, by `distance` (m)."""
        x, y, z = np.array(self.centre) + distance * np.array(self.along)
        along, out, up = self.limb_place
        return replace(
            self, centre=(float(x), float(y), float(z)), limb_place=(along + distance, out, up)
        )
