"""The compression test of the soft tissue (paper, section 2.2.3.1, equation 18 and figure 6).

The upper arm's own tissue, as it sits on the arm, is pressed between two plates.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim.body.skeleton import empty_spec
from sim.body.soft_tissue import (
    ELEMENT_RADIUS,
    SoftTissue,
    add_soft_tissue,
    element_name,
    set_contacts,
    soft_tissues,
)
from sim.parameters.conditions import DEFAULT_CONDITIONS, TISSUE_COUPLING
from sim.parameters.fidelity import REFERENCE
from sim.parameters.wearer import NOMINAL_WEARER
from sim.system.solver import set_solver

#: Force on each plate, N, in increasing steps.
LOADS_N = np.array([1, 2, 5, 10, 20, 35, 55, 80, 110, 150, 190, 250, 320, 400], dtype=float)
#: Elasticities of the test, N/m: Table 1's lowest, nominal and highest.
ELASTICITIES = (100.5, 537.465, 974.43)
#: Young's modulus of mammal muscle fibres, relaxed and contracted, Pa (Ogneva et al. 2010, as the
#: authors' code has it).
OGNEVA_RELAXED, OGNEVA_CONTRACTED = 30e3, 66e3
#: Seconds at each load until the tissue rests.
_SETTLE = 2.0
_PLATE_MASS = 1.0


@dataclass(frozen=True, kw_only=True)
class CompressionTest:
    """A limb's tissue under increasing load; arrays have shape (len(LOADS_N),)."""

    #: Stiffness of one element, N/m.
    elasticity: float
    #: Shortening between the plates over their distance at first touch.
    strain: np.ndarray
    #: Force over the area the plates can cover, Pa.
    stress: np.ndarray

    @property
    def modulus(self) -> np.ndarray:
        """Secant Young's modulus at every load, Pa (equation 18)."""
        modulus: np.ndarray = self.stress / self.strain
        return modulus

    def modulus_at(self, strain: float) -> float:
        """Return the secant modulus (Pa) at a strain, interpolated between loads.

        Raises:
            ValueError: the test did not reach that strain.
        """
        if not self.strain[0] <= strain <= self.strain[-1]:
            raise ValueError(
                f"the test of {self.elasticity:g} N/m covers strains from {self.strain[0]:.3f} "
                f"to {self.strain[-1]:.3f}, not {strain:g}"
            )
        return float(np.interp(strain, self.strain, self.stress)) / strain


def run_compression_test(
    elasticity: float, *, coupling: float = TISSUE_COUPLING
) -> CompressionTest:
    """Press the upper arm's nominal tissue with elements of `elasticity` (N/m).

    `coupling` is the stiffness of the springs between neighbours as a share of that.
    """
    tissue = replace(soft_tissues(NOMINAL_WEARER)[0], elasticity=elasticity, coupling=coupling)
    model = _build(tissue)
    data = mujoco.MjData(model)
    upper, lower = data.joint("upper_plate"), data.joint("lower_plate")
    height = tissue_height(tissue)
    heights = np.empty(len(LOADS_N))
    for i, load in enumerate(LOADS_N):
        upper.qfrc_applied, lower.qfrc_applied = -load, load
        mujoco.mj_step(model, data, round(_SETTLE / REFERENCE.step))
        heights[i] = height + upper.qpos[0] - lower.qpos[0]
    return CompressionTest(
        elasticity=elasticity,
        strain=(height - heights) / height,
        stress=LOADS_N / (2 * tissue.radius * (tissue.end - tissue.start)),
    )


def tissue_height(tissue: SoftTissue) -> float:
    """Return the distance of two plates that just touch the tissue above and below, m."""
    tops = []
    for index in range(tissue.per_ring):
        skin, normal = tissue.element(0, index)
        centre = skin - ELEMENT_RADIUS * normal
        tops.append(centre[2] - tissue.axis_z + ELEMENT_RADIUS)
    return 2.0 * float(max(tops))


def _build(tissue: SoftTissue) -> mujoco.MjModel:
    """Return a tissue on a fixed bone between plates that slide towards it, without gravity."""
    spec = empty_spec()
    # A contact is softer the longer the step, and the plates are not what is tested.
    set_solver(spec, REFERENCE.step)
    set_contacts(spec, DEFAULT_CONDITIONS.cuff_friction)
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.worldbody.add_body(name=tissue.bone)
    add_soft_tissue(spec, tissue)
    half_length = (tissue.end - tissue.start) / 2
    for name, side in (("upper_plate", 1.0), ("lower_plate", -1.0)):
        plate = spec.worldbody.add_body(
            name=name,
            pos=[
                (tissue.start + tissue.end) / 2,
                tissue.axis_y,
                tissue.axis_z + side * (tissue_height(tissue) / 2 + 0.01),
            ],
        )
        plate.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0.0, 0.0, 1.0],
            damping=[50.0, 0.0, 0.0],
        )
        plate.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[1.5 * half_length, 2 * tissue.radius, 0.01],
            mass=_PLATE_MASS,
            contype=0,
            conaffinity=0,
        )
        for ring, index in tissue.places:
            _, normal = tissue.element(ring, index)
            if side * normal[2] > 0.0:
                spec.add_pair(geomname1=element_name(tissue, ring, index), geomname2=name)
    return spec.compile()
