"""The interface without contact: each cuff holds its limb by a bushing of six dimensions.

After Kühn et al. 2018. A bushing is viscoelastic: seven rods of springs, so long that their
directions stay those of the cuff: four radial ones at two places along the limb, which also resist
tilting, one axial, and two that resist torsion. Nothing slips, rolls or loses contact, so the
response is smooth and an assessment takes milliseconds; `docs/measurements/fidelities.md` says
how far it agrees with contact.
"""

import mujoco
import numpy as np

from sim.body.soft_tissue import BONE_CLEARANCE, HARDENING, SoftTissue
from sim.interface.interface import OF_ELEMENTS, Interface, Loads
from sim.robot.cuff import Cuff

#: Length of a rod, m: over 5 cm of displacement its direction turns by one degree.
ROD = 3.0
#: Stiffness of cuff and strap in series with the tissue, N/m (compression of contacts and strap).
CUFF_STIFFNESS = 1e5
#: Damping of the rods as a share of the tissue's. The integrator takes damping between two trees
#: for inertia on each, step x damping: all of it is 0.6 kg m2 at the elbow, five times the forearm,
#: and 0.3 Nm/rad of stiffness. With half of it errors are closest to those of contact.
DAMPING_SHARE = 0.5
#: Axial stiffness, N/m: friction holds a limb, whatever the tissue. But only so far: what it holds
#: with is largest, 85 N, where a limb has slid by LETS_GO / sqrt(3), 3 cm (m).
AXIAL_STIFFNESS, LETS_GO = 4000.0, 0.055
#: Stiffness of both rods that resist torsion, N/m: friction's too, which holds a limb whatever the
#: tissue (as a share of the radial one the softest tissue let go of it).
TORSIONAL_STIFFNESS = 4000.0
#: What a rod's stiffness gains per square of its stretch, as a share of itself, 1/m2: pressed
#: tissue hardens, friction along the limb gives way.
CURVATURES = {"radial": 1.0 / HARDENING**2, "axial": -1.0 / LETS_GO**2, "torsion": 0.0}
RODS = ("radial_1", "radial_2", "radial_3", "radial_4", "axial", "torsion_1", "torsion_2")


class Bushings(Interface):
    """A bushing for each limb, unloaded in the seat."""

    def add(self, spec: mujoco.MjSpec) -> None:
        """Add the rods and, after what is measured already, their lengths and then their speeds."""
        for cuff, tissue, seat in zip(self.cuffs, self.tissues, self.seats, strict=True):
            _add_bushing(spec, cuff, tissue, *seat)
        for kind in (mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtSensor.mjSENS_TENDONVEL):
            for rod in self.rods:
                # Without a name: to keep one costs more than to measure.
                spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_TENDON, objname=rod)

    @property
    def rods(self) -> list[str]:
        """Names of the rods of both bushings."""
        return [f"{cuff.name}_{rod}" for cuff in self.cuffs for rod in RODS]

    def loads(self, model: mujoco.MjModel, states: np.ndarray, sensed: np.ndarray) -> Loads:
        """Return the loads in n steps; there is no strap to lose, and the springs are the tissue.

        An axial rod that is stretched by more than LETS_GO pushes the limb on.
        """
        rods = [model.tendon(rod).id for rod in self.rods]
        length, speed = np.split(sensed[:, -2 * len(rods) :], 2, axis=1)
        stretch = length - ROD
        stiffness = model.tendon_stiffness[rods] + model.tendon_stiffnesspoly[rods, 1] * stretch**2
        tension = stiffness * stretch + model.tendon_damping[rods] * speed
        shape = (len(sensed), len(self.cuffs), len(RODS))
        tension, stretch = tension.reshape(shape), stretch.reshape(shape)
        opening, wall = tension[:, :, :2].sum(axis=2), tension[:, :, [2, 3, 5, 6]].sum(axis=2)
        # Along limb, opening and wall.
        forces = np.stack([tension[:, :, 4], opening, wall], axis=2)
        across = np.hypot(stretch[:, :, :2].mean(axis=2), stretch[:, :, 2:4].mean(axis=2))
        radius = np.array([cuff.radius for cuff in self.cuffs])
        room = radius - BONE_CLEARANCE
        return Loads(
            contact_force=np.linalg.norm(forces, axis=2),
            normal_force=np.linalg.norm(forces[:, :, 1:], axis=2).sum(axis=1),
            penetration=across - room,
            overhang=self._overhang(stretch[:, :, 4]),
            roll=np.abs(stretch[:, :, 5] - stretch[:, :, 6]) / 2 / radius,
            slide=np.abs(stretch[:, :, 4]) / LETS_GO,
            tissue_left=room - across,
            tissue_share=np.ones_like(across),
            strap_tension=np.full_like(across, np.inf),
            unheld=np.zeros_like(across),
            **dict.fromkeys(OF_ELEMENTS, np.full_like(across, np.nan)),
        )

    def _overhang(self, slide: np.ndarray) -> np.ndarray:
        """Return how far each cuff's centre, `slide` (n, 2) from its seat, is off the tissue, m."""
        place = slide + np.array([seat[0] for seat, _ in self.seats])
        start = np.array([tissue.start for tissue in self.tissues])
        end = np.array([tissue.end for tissue in self.tissues])
        overhang: np.ndarray = np.maximum(start - place, place - end)
        return overhang


def _add_bushing(
    spec: mujoco.MjSpec, cuff: Cuff, tissue: SoftTissue, centre: np.ndarray, axes: np.ndarray
) -> None:
    """Join one limb to its cuff; `centre` and `axes` are the cuff's, in the limb's bone."""
    # Half of the elements under the cuff, because each shares in a load across the limb by the
    # square of the cosine to its direction.
    engaged = len(tissue.places) * cuff.length / (tissue.end - tissue.start) / 2
    pressed = engaged * tissue.elasticity
    radial = pressed * CUFF_STIFFNESS / (pressed + CUFF_STIFFNESS)
    relaxation = DAMPING_SHARE * tissue.viscosity / tissue.elasticity * radial / pressed
    in_link = cuff.axes
    lever = cuff.length / 2 / np.sqrt(3.0)
    link, bone = spec.body(cuff.link), spec.body(tissue.bone)
    for name, at, towards, stiffness in (
        ("radial_1", (lever, 0.0, 0.0), 1, radial / 2),
        ("radial_2", (-lever, 0.0, 0.0), 1, radial / 2),
        ("radial_3", (lever, 0.0, 0.0), 2, radial / 2),
        ("radial_4", (-lever, 0.0, 0.0), 2, radial / 2),
        ("axial", (0.0, 0.0, 0.0), 0, AXIAL_STIFFNESS),
        ("torsion_1", (0.0, cuff.radius, 0.0), 2, TORSIONAL_STIFFNESS),
        ("torsion_2", (0.0, -cuff.radius, 0.0), 2, TORSIONAL_STIFFNESS),
    ):
        place = np.array(at)
        curvature = CURVATURES[name.split("_")[0]]
        name = f"{cuff.name}_{name}"
        bone.add_site(name=f"{name}_limb", pos=centre + axes @ place)
        link.add_site(
            name=f"{name}_cuff",
            pos=np.array(cuff.centre) + in_link @ place + ROD * in_link[:, towards],
        )
        rod = spec.add_tendon(
            name=name,
            stiffness=[stiffness, 0.0, curvature * stiffness],
            damping=[relaxation * stiffness, 0.0, 0.0],
            springlength=[ROD, ROD],
            # So long that they would fill every picture.
            rgba=[0.0, 0.0, 0.0, 0.0],
        )
        rod.wrap_site(f"{name}_limb")
        rod.wrap_site(f"{name}_cuff")
