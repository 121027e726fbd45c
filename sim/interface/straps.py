"""Straps: grids of particles on springs over the open halves of the cuffs (paper, figure 5)."""

from itertools import pairwise
from math import pi, tan

import mujoco
import numpy as np

from sim.interface.cuffs import add_box
from sim.parameters.fidelity import Fidelity
from sim.robot.cuff import Cuff

STRAP_THICKNESS = 0.020
#: Weight of one strap, kg; the nominal model knows it.
STRAP_MASS = 0.05
#: Stiffness of a strap from rim to rim, N/m, and damping of each of its segments, N s/m.
STRAP_STIFFNESS = 10_000.0
SEGMENT_DAMPING = 100.0
#: Stiffness between the rows (N/m), against bending (N/m), and of the edges in the cuff (N/m).
BETWEEN_ROWS, BENDING, EDGE = 10_000.0, 200.0, 500.0
PARTICLE_DAMPING = 20.0
#: Rim of a cuff: where strap ends are fixed, in inner radii.
RIM = 1.03


def strap_angles(fidelity: Fidelity) -> list[float]:
    """Return the angle of each particle of a row from the opening, rad."""
    across = fidelity.strap_across
    return [-pi / 2 + (i + 0.5) * pi / across for i in range(across)]


def row_offsets(cuff: Cuff, fidelity: Fidelity) -> list[float]:
    """Return the position of each strap row along the limb from the cuff's centre, m."""
    rows = fidelity.strap_rows
    return [(row + 0.5) * cuff.length / rows - cuff.length / 2 for row in range(rows)]


def particle_name(cuff: Cuff, row: int, index: int) -> str:
    return f"{cuff.name}_strap_{row}_{index}"


def segment_names(cuff: Cuff, fidelity: Fidelity) -> list[str]:
    """Return the names of the tendons that carry the strap's tension."""
    return [
        f"{cuff.name}_band_{row}_{i}"
        for row in range(fidelity.strap_rows)
        for i in range(fidelity.strap_across + 1)
    ]


def add_strap(spec: mujoco.MjSpec, cuff: Cuff, fidelity: Fidelity) -> None:
    """Add the strap's particles and the springs between them, still open (without tension)."""
    link = spec.body(cuff.link)
    rows, across = fidelity.strap_rows, fidelity.strap_across
    for row, offset in enumerate(row_offsets(cuff, fidelity)):
        middle = np.array(cuff.centre) + offset * np.array(cuff.along)
        for side, angle in (("low", -pi / 2), ("high", pi / 2)):
            link.add_site(
                name=f"{cuff.name}_rim_{row}_{side}",
                pos=middle + RIM * cuff.radius * cuff.normal(angle),
                size=[0.002] * 3,
            )
        for i, angle in enumerate(strap_angles(fidelity)):
            _add_particle(link, cuff, fidelity, (row, i), middle, angle)
        sites = [
            f"{cuff.name}_rim_{row}_low",
            *(particle_name(cuff, row, i) for i in range(across)),
            f"{cuff.name}_rim_{row}_high",
        ]
        for i, ends in enumerate(pairwise(sites)):
            _add_spring(
                spec,
                f"{cuff.name}_band_{row}_{i}",
                ends,
                stiffness=(across + 1) * STRAP_STIFFNESS / rows,
                damping=SEGMENT_DAMPING,
                width=0.003,
            )
        for i in range(across - 1):
            a, b = (f"{particle_name(cuff, row, j)}_radial" for j in (i, i + 1))
            bending = spec.add_tendon(
                name=f"{cuff.name}_bending_{row}_{i}",
                stiffness=[BENDING, 0.0, 0.0],
                damping=[PARTICLE_DAMPING, 0.0, 0.0],
            )
            bending.wrap_joint(a, 1.0)
            bending.wrap_joint(b, -1.0)
    for row in range(rows - 1):
        for i in range(across):
            _add_spring(
                spec,
                f"{cuff.name}_between_{row}_{i}",
                (particle_name(cuff, row, i), particle_name(cuff, row + 1, i)),
                stiffness=BETWEEN_ROWS,
                damping=SEGMENT_DAMPING,
                width=0.001,
            )


def _add_particle(
    link: mujoco.MjsBody,
    cuff: Cuff,
    fidelity: Fidelity,
    place: tuple[int, int],
    middle: np.ndarray,
    angle: float,
) -> None:
    """Add the particle at `place`, row and index, of a strap whose row has its `middle` there."""
    rows, across = fidelity.strap_rows, fidelity.strap_across
    name = particle_name(cuff, *place)
    frame = cuff.box_frame(angle)
    tangent, normal, along = frame.T
    body = link.add_body(name=name, pos=middle + (cuff.radius + STRAP_THICKNESS / 2) * normal)
    at_edge = place[1] in (0, across - 1)
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
            armature=fidelity.particle_inertia,
        )
    body.add_site(
        name=name,
        pos=(RIM * cuff.radius - cuff.radius - STRAP_THICKNESS / 2) * normal,
        size=[0.002] * 3,
    )
    add_box(
        body,
        name,
        np.zeros(3),
        frame=frame,
        size=[
            (cuff.radius + STRAP_THICKNESS) * tan(pi / across / 2),
            STRAP_THICKNESS / 2,
            cuff.length / rows / 2,
        ],
        mass=STRAP_MASS / (rows * across),
        rgba=(0.15, 0.15, 0.18, 0.6),
    )


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
