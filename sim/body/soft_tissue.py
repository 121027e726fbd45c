"""The soft tissue of upper arm and forearm: micro-elements on springs (paper, section 2.2.3).

Each limb carries a cylinder of spheres on radial slides. The paper's three kinds of soft
constraints are there: central-external (the slide's spring), external-neighbours (a tendon between
two elements) and one that preserves the volume (a tendon over all). They are springs, so that Table
1's N/m means N/m: the authors' own equality constraints scale with the element's mass.
"""

from dataclasses import dataclass, replace
from math import pi

import mujoco
import numpy as np

from sim.parameters.conditions import TISSUE_COUPLING
from sim.parameters.fidelity import CAMPAIGN, Fidelity
from sim.parameters.wearer import Wearer

#: Radius of an element, m: large enough that none can catch on the edge of a cuff.
ELEMENT_RADIUS = 0.024
#: Inertia of an element's slide, kg: it has no weight and adds nothing to the limb's inertia, but
#: makes step x viscosity comparable with mass, without which contacts are far too soft.
ELEMENT_INERTIA = 4.0
#: Viscosity of one element, N s/m (paper, section 2.4.1).
VISCOSITY = 100.0
#: Elements of a limb that Table 1's N/m and the paper's N s/m are for; more share them.
REFERENCE_ELEMENTS = 96
#: Deflection at which the spring has doubled its stiffness, m: flesh hardens under load.
HARDENING = 0.012
#: Thickness that remains over the bone, m; the slide's stop lies there.
BONE_CLEARANCE = 0.012
#: Where the upper arm's tissue begins, from the shoulder, unless a cuff lies nearer; its length;
#: and the least of it above a cuff; nominally, m.
UPPER_ARM_START, UPPER_ARM_TISSUE, ABOVE_CUFF = 0.09, 0.13, 0.005
#: Farthest an element may bulge outwards, m.
BULGE = 0.03


@dataclass(frozen=True, kw_only=True)
class SoftTissue:
    """The tissue of one limb, in the frame of the bone that carries it (x along the limb), in m."""

    name: str
    bone: str
    radius: float
    start: float
    end: float
    axis_y: float
    axis_z: float
    #: Its mass, kg (paper's totals less Table 1's centre values).
    mass: float
    #: Stiffness (N/m) and viscosity (N s/m) of one of REFERENCE_ELEMENTS elements at rest.
    elasticity: float
    viscosity: float
    #: Elements along and around the limb.
    rings: int
    per_ring: int
    #: Stiffness of the springs between neighbours, as a share of an element's own.
    coupling: float = TISSUE_COUPLING

    @property
    def share(self) -> float:
        """What one of our elements has of a reference one's stiffness and viscosity."""
        return REFERENCE_ELEMENTS / (self.rings * self.per_ring)

    @property
    def places(self) -> list[tuple[int, int]]:
        """Ring and index of every element."""
        return [(ring, i) for ring in range(self.rings) for i in range(self.per_ring)]

    @property
    def element_area(self) -> float:
        """The skin that one element stands for, m2."""
        return 2 * pi * self.radius * (self.end - self.start) / len(self.places)

    def element(self, ring: int, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the skin point (m) of an element and the outward normal there."""
        x = self.start + (ring + 0.5) * (self.end - self.start) / self.rings
        angle = 2 * pi * index / self.per_ring
        normal = np.array([0.0, np.cos(angle), np.sin(angle)])
        return np.array([x, self.axis_y, self.axis_z]) + self.radius * normal, normal

    def spring_forces(self, outwards: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return what its springs and damper do to each element, N outwards, shape (n, elements).

        Args:
            outwards: each element from its rest, m, shape (n, elements), ring by ring.
            speed: of each, m/s, of that shape.
        """
        stiffness, neighbours = self.share * self.elasticity, self.coupling * self.elasticity
        rings = outwards.reshape(len(outwards), self.rings, self.per_ring)
        pull = 2 * rings - np.roll(rings, 1, axis=2) - np.roll(rings, -1, axis=2)
        along = np.diff(rings, axis=1)
        pull[:, :-1] -= along
        pull[:, 1:] += along
        forces: np.ndarray = -(
            stiffness * outwards * (1.0 + (outwards / HARDENING) ** 2)
            + self.share * self.viscosity * speed
            + neighbours * pull.reshape(outwards.shape)
            + stiffness / len(self.places) * over_elements(outwards)[:, None]
        )
        return forces


def over_elements(values: np.ndarray) -> np.ndarray:
    """Return the sums of rows over elements, shape (n,) of (n, elements), added one after another.

    NumPy's own order depends on how many rows there are and on how they lie in memory.
    """
    sums: np.ndarray = np.cumsum(values, axis=1)[:, -1]
    return sums


def soft_tissues(
    wearer: Wearer,
    *,
    tissue_scale: float = 1.0,
    coupling: float = TISSUE_COUPLING,
    fidelity: Fidelity = CAMPAIGN,
    upper_start: float = UPPER_ARM_START,
) -> tuple[SoftTissue, SoftTissue]:
    """Return the tissue of upper arm and forearm; that of the upper arm from `upper_start` on, m.

    `tissue_scale` multiplies stiffness and viscosity of both; `coupling` the stiffness between
    neighbours alone.

    Masses are what the paper's totals (2.25 and 1.31 kg) leave beside 1.761 and 0.962 kg.
    """
    su, sl = wearer.upper_arm_scale, wearer.forearm_scale
    upper_arm = SoftTissue(
        name="upper_arm",
        bone="humerus",
        radius=0.040,
        start=upper_start * su,
        end=(upper_start + UPPER_ARM_TISSUE) * su,
        axis_y=0.0,
        axis_z=0.0,
        mass=0.489,
        elasticity=tissue_scale * wearer.upper_arm_elasticity,
        viscosity=tissue_scale * VISCOSITY,
        rings=fidelity.rings,
        per_ring=fidelity.per_ring,
        coupling=coupling,
    )
    forearm = replace(
        upper_arm,
        name="forearm",
        bone="ulna",
        radius=0.035,
        start=0.06 * sl,
        end=0.22 * sl,
        axis_y=-0.01 * sl,
        axis_z=0.015 * sl,
        mass=0.351,
        elasticity=tissue_scale * wearer.forearm_elasticity,
    )
    return upper_arm, forearm


def element_name(tissue: SoftTissue, ring: int, index: int) -> str:
    return f"{tissue.name}_tissue_{ring}_{index}"


def set_contacts(spec: mujoco.MjSpec, friction: float, fidelity: Fidelity = CAMPAIGN) -> None:
    """Give contacts of elements, which are added afterwards, their stiffness and friction."""
    pair = spec.default.pair
    pair.condim = 3
    pair.friction[:2] = friction
    pair.solref = [0.02, 1.0]
    onset, depth = fidelity.onset
    pair.solimp = [onset, 0.99, depth, 0.5, 2.0]


def add_soft_tissue(spec: mujoco.MjSpec, tissue: SoftTissue) -> None:
    """Add the tissue of one limb to a spec that has the bone it sits on."""
    count = len(tissue.places)
    mass = tissue.mass / (count + 1)
    bone = spec.body(tissue.bone)
    core = bone.add_body(
        name=f"{tissue.name}_tissue",
        pos=[(tissue.start + tissue.end) / 2, tissue.axis_y, tissue.axis_z],
    )
    core.explicitinertial = True
    core.ipos = [0.0, 0.0, 0.0]
    core.mass = mass
    core.inertia = [mass * ELEMENT_RADIUS**2 * 0.4] * 3
    for ring, index in tissue.places:
        _add_element(bone, tissue, ring, index, mass)
    for ring, index in tissue.places if tissue.coupling > 0.0 else ():
        _add_neighbour(spec, tissue, (ring, index), (ring, (index + 1) % tissue.per_ring))
        if ring + 1 < tissue.rings:
            _add_neighbour(spec, tissue, (ring, index), (ring + 1, index))
    volume = spec.add_tendon(
        name=f"{tissue.name}_volume",
        stiffness=[tissue.share * tissue.elasticity / count, 0.0, 0.0],
        springlength=[0.0, 0.0],
    )
    for ring, index in tissue.places:
        volume.wrap_joint(element_name(tissue, ring, index), 1.0)


def _add_element(
    bone: mujoco.MjsBody, tissue: SoftTissue, ring: int, index: int, mass: float
) -> None:
    name = element_name(tissue, ring, index)
    skin, normal = tissue.element(ring, index)
    stiffness = tissue.share * tissue.elasticity
    body = bone.add_body(name=name, pos=skin)
    slide = body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=normal,
        stiffness=[stiffness, 0.0, stiffness / HARDENING**2],
        damping=[tissue.share * tissue.viscosity, 0.0, 0.0],
        armature=ELEMENT_INERTIA,
        range=[-(tissue.radius - BONE_CLEARANCE), BULGE],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        solref_limit=[0.02, 1.0],
    )
    slide.solimp_limit[:3] = [0.95, 0.99, 0.002]
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[ELEMENT_RADIUS, 0, 0],
        pos=-ELEMENT_RADIUS * normal,
        mass=mass,
        rgba=[0.85, 0.55, 0.5, 0.35],
        group=2,
        contype=0,
        conaffinity=0,
    )


def _add_neighbour(
    spec: mujoco.MjSpec, tissue: SoftTissue, first: tuple[int, int], second: tuple[int, int]
) -> None:
    a, b = element_name(tissue, *first), element_name(tissue, *second)
    tendon = spec.add_tendon(
        name=f"{a}-{b}", stiffness=[tissue.coupling * tissue.elasticity, 0.0, 0.0]
    )
    tendon.wrap_joint(a, 1.0)
    tendon.wrap_joint(b, -1.0)
