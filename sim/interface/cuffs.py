"""Cuffs and straps: how the exoskeleton holds the arm (paper, section 2.2.3, figure 5).

A cuff is a half cylinder of welded boxes that opens medially; a strap is a grid of particles on
springs over the open half. Tissue touches only its own cuff and strap, through explicit contact
pairs.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import cos, pi, radians, sin, tan

import mujoco
import numpy as np

from sim.body.soft_tissue import Sleeve, element_name
from sim.parameters.fidelity import CAMPAIGN, Fidelity

#: Boxes of a cuff, which span half a circle.
BOXES = 6
CUFF_THICKNESS = 0.030
STRAP_THICKNESS = 0.020
#: Weight of one strap, kg; the nominal model knows it.
STRAP_MASS = 0.05
#: Stiffness of a strap from rim to rim, N/m, and damping of each of its segments, N s/m.
STRAP_STIFFNESS = 10_000.0
SEGMENT_DAMPING = 100.0
#: Stiffness between the rows (N/m), against bending (N/m), and of the edges in the cuff (N/m).
BETWEEN_ROWS, BENDING, EDGE = 10_000.0, 200.0, 500.0
PARTICLE_DAMPING = 20.0
#: Tissue and box meet only if their normals differ by less than this, rad.
CONTACT_SECTOR = radians(80.0)
#: Rim of a cuff: where strap ends are fixed, in inner radii.
RIM = 1.03
#: Body and joint of the slide.
SLIDE = "forearm_cuff_slide"
#: A cuff on a slide: inertia, kg, and damping, N s/m.
SLIDE_INERTIA, SLIDE_DAMPING = 1.0, 20.0


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
    #: Strap particles along the limb and across it.
    rows: int = CAMPAIGN.strap_rows
    across: int = CAMPAIGN.strap_across
    particle_inertia: float = CAMPAIGN.particle_inertia

    @cached_property
    def wall(self) -> np.ndarray:
        """Unit vector towards the upper wall: along x opening."""
        (x, y, z), (u, v, w) = self.along, self.opening
        return np.array([y * w - z * v, z * u - x * w, x * v - y * u])

    def normal(self, angle: float) -> np.ndarray:
        """Unit vector out of the cuff's axis, `angle` rad from the opening to the upper wall."""
        return cos(angle) * np.array(self.opening, dtype=float) + sin(angle) * self.wall

    def box_frame(self, angle: float) -> np.ndarray:
        """Return a right-handed frame, columns tangent, normal, along, shape (3, 3)."""
        tangent = sin(angle) * np.array(self.opening, dtype=float) - cos(angle) * self.wall
        return np.column_stack([tangent, self.normal(angle), self.along])

    @property
    def cuff_angles(self) -> list[float]:
        return [pi / 2 + (i + 0.5) * pi / BOXES for i in range(BOXES)]

    @property
    def strap_angles(self) -> list[float]:
        return [-pi / 2 + (i + 0.5) * pi / self.across for i in range(self.across)]

    @property
    def row_offsets(self) -> list[float]:
        """Position of each strap row along the limb from the centre, m."""
        return [(row + 0.5) * self.length / self.rows - self.length / 2 for row in range(self.rows)]


def cuffs(
    pair: tuple[Cuff, Cuff],
    fidelity: Fidelity,
    *,
    position: float = 0.0,
    upper_position: float = 0.0,
    slides: bool = False,
) -> tuple[Cuff, Cuff]:
    """Return both cuffs as divided at a fidelity.

    Args:
        pair: the device's cuffs of upper arm and forearm.
        fidelity: how finely the straps are divided.
        position: the forearm's cuff moved towards the hand, m.
        upper_position: the upper arm's cuff moved towards the elbow, m.
        slides: whether the forearm's cuff is carried by a slide of its own.
    """
    upper_arm, forearm = (
        replace(
            cuff,
            rows=fidelity.strap_rows,
            across=fidelity.strap_across,
            particle_inertia=fidelity.particle_inertia,
        )
        for cuff in pair
    )
    upper_arm, forearm = _moved(upper_arm, upper_position), _moved(forearm, position)
    return upper_arm, replace(forearm, link=SLIDE if slides else forearm.link)


def _moved(cuff: Cuff, distance: float) -> Cuff:
    """Return the cuff moved along its limb, distally, by `distance` (m)."""
    x, y, z = np.array(cuff.centre) + distance * np.array(cuff.along)
    along, out, up = cuff.limb_place
    return replace(
        cuff, centre=(float(x), float(y), float(z)), limb_place=(along + distance, out, up)
    )


def add_slide(spec: mujoco.MjSpec, forearm: Cuff, compliance: float) -> None:
    """Add the slide that may carry the forearm's cuff along the forearm; `compliance` in m/N."""
    slide = spec.body(forearm.link).add_body(name=SLIDE)
    slide.explicitinertial = True
    slide.ipos = [0.0, 0.0, 0.0]
    slide.mass, slide.inertia = 1e-6, [1e-9] * 3
    slide.add_joint(
        name=SLIDE,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=list(forearm.along),
        stiffness=[1.0 / compliance, 0.0, 0.0],
        damping=[SLIDE_DAMPING, 0.0, 0.0],
        armature=SLIDE_INERTIA,
    )


def cuff_box_name(cuff: Cuff, index: int) -> str:
    return f"{cuff.name}_cuff_{index}"


def particle_name(cuff: Cuff, row: int, index: int) -> str:
    return f"{cuff.name}_strap_{row}_{index}"


def segment_names(cuff: Cuff) -> list[str]:
    """Return the names of the tendons that carry the strap's tension."""
    return [
        f"{cuff.name}_band_{row}_{i}" for row in range(cuff.rows) for i in range(cuff.across + 1)
    ]


def add_cuff(spec: mujoco.MjSpec, cuff: Cuff) -> None:
    """Add the cuff's boxes to its link."""
    link = spec.body(cuff.link)
    half_width = (cuff.radius + CUFF_THICKNESS) * tan(pi / BOXES / 2)
    for i, angle in enumerate(cuff.cuff_angles):
        centre = np.array(cuff.centre) + (cuff.radius + CUFF_THICKNESS / 2) * cuff.normal(angle)
        _add_box(
            link,
            cuff_box_name(cuff, i),
            centre,
            frame=cuff.box_frame(angle),
            size=[half_width, CUFF_THICKNESS / 2, cuff.length / 2],
            mass=0.0,
            rgba=(0.2, 0.45, 0.75, 0.45),
        )


def add_strap(spec: mujoco.MjSpec, cuff: Cuff) -> None:
    """Add the strap's particles and the springs between them, still open (without tension)."""
    link = spec.body(cuff.link)
    for row, offset in enumerate(cuff.row_offsets):
        middle = np.array(cuff.centre) + offset * np.array(cuff.along)
        for side, angle in (("low", -pi / 2), ("high", pi / 2)):
            link.add_site(
                name=f"{cuff.name}_rim_{row}_{side}",
                pos=middle + RIM * cuff.radius * cuff.normal(angle),
                size=[0.002] * 3,
            )
        for i, angle in enumerate(cuff.strap_angles):
            _add_particle(link, cuff, row, i, middle, angle)
        sites = [
            f"{cuff.name}_rim_{row}_low",
            *(particle_name(cuff, row, i) for i in range(cuff.across)),
            f"{cuff.name}_rim_{row}_high",
        ]
        for i, ends in enumerate(pairwise(sites)):
            _add_spring(
                spec,
                f"{cuff.name}_band_{row}_{i}",
                ends,
                stiffness=(cuff.across + 1) * STRAP_STIFFNESS / cuff.rows,
                damping=SEGMENT_DAMPING,
                width=0.003,
            )
        for i in range(cuff.across - 1):
            a, b = (f"{particle_name(cuff, row, j)}_radial" for j in (i, i + 1))
            bending = spec.add_tendon(
                name=f"{cuff.name}_bending_{row}_{i}",
                stiffness=[BENDING, 0.0, 0.0],
                damping=[PARTICLE_DAMPING, 0.0, 0.0],
            )
            bending.wrap_joint(a, 1.0)
            bending.wrap_joint(b, -1.0)
    for row in range(cuff.rows - 1):
        for i in range(cuff.across):
            _add_spring(
                spec,
                f"{cuff.name}_between_{row}_{i}",
                (particle_name(cuff, row, i), particle_name(cuff, row + 1, i)),
                stiffness=BETWEEN_ROWS,
                damping=SEGMENT_DAMPING,
                width=0.001,
            )


def add_contacts(spec: mujoco.MjSpec, cuff: Cuff, sleeve: Sleeve) -> None:
    """Let the sleeve's elements meet the boxes and particles that face them."""
    faces = [(cuff_box_name(cuff, i), angle) for i, angle in enumerate(cuff.cuff_angles)]
    faces += [
        (particle_name(cuff, row, i), angle)
        for row in range(cuff.rows)
        for i, angle in enumerate(cuff.strap_angles)
    ]
    for ring, index in sleeve.places:
        _, normal = sleeve.element(ring, index)
        for box, angle in faces:
            # In the zero pose the bone's y axis points out of the opening, its z axis to the wall.
            if normal[1] * cos(angle) + normal[2] * sin(angle) <= cos(CONTACT_SECTOR):
                continue
            spec.add_pair(geomname1=element_name(sleeve, ring, index), geomname2=box)


def _add_particle(
    link: mujoco.MjsBody, cuff: Cuff, row: int, index: int, middle: np.ndarray, angle: float
) -> None:
    name = particle_name(cuff, row, index)
    frame = cuff.box_frame(angle)
    tangent, normal, along = frame.T
    body = link.add_body(name=name, pos=middle + (cuff.radius + STRAP_THICKNESS / 2) * normal)
    at_edge = index in (0, cuff.across - 1)
    for direction, axis, stiffness in (
        ("radial", normal, 0.0),
        ("tangential", tangent, EDGE if at_edge else 0.0),
        ("axial", along, EDGE if at_edge else 0.0),
    ):
        body.add_joint(
            name=f"{name}_{direction}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            stiffness=[stiffness, 0.0, 0.0],
            damping=[PARTICLE_DAMPING, 0.0, 0.0],
            armature=cuff.particle_inertia,
        )
    body.add_site(
        name=name,
        pos=(RIM * cuff.radius - cuff.radius - STRAP_THICKNESS / 2) * normal,
        size=[0.002] * 3,
    )
    _add_box(
        body,
        name,
        np.zeros(3),
        frame=frame,
        size=[
            (cuff.radius + STRAP_THICKNESS) * tan(pi / cuff.across / 2),
            STRAP_THICKNESS / 2,
            cuff.length / cuff.rows / 2,
        ],
        mass=STRAP_MASS / (cuff.rows * cuff.across),
        rgba=(0.15, 0.15, 0.18, 0.6),
    )


def _add_box(
    body: mujoco.MjsBody,
    name: str,
    centre: np.ndarray,
    *,
    frame: np.ndarray,
    size: list[float],
    mass: float,
    rgba: tuple[float, float, float, float],
) -> None:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, frame.ravel())
    geom = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        quat=quat,
        size=size,
        mass=mass,
        rgba=list(rgba),
        group=1,
    )
    geom.contype = geom.conaffinity = 0


def _add_spring(
    spec: mujoco.MjSpec,
    name: str,
    sites: tuple[str, str],
    *,
    stiffness: float,
    damping: float,
    width: float,
) -> None:
    tendon = spec.add_tendon(
        name=name,
        stiffness=[stiffness, 0.0, 0.0],
        damping=[damping, 0.0, 0.0],
        width=width,
        rgba=[0.1, 0.1, 0.1, 1.0],
    )
    for site in sites:
        tendon.wrap_site(site)
