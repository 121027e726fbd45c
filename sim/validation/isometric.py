"""The maximal isometric torque test of the elbow (paper, section 2.2.1.1 and figure 3)."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.body.muscles.attach import add_muscles
from sim.body.muscles.authors import PAPER_MUSCLES
from sim.body.muscles.muscle import ElbowMuscles, Muscle
from sim.body.skeleton import HUMAN_JOINTS, add_arm, add_torso, empty_spec
from sim.parameters.wearer import NOMINAL_WEARER

#: Elbow angles of the test, degrees: steps of one degree, as in the paper.
ANGLES_DEG = np.arange(0.0, 131.0)


@dataclass(frozen=True, kw_only=True)
class DataSet:
    """Measured isometric torques of healthy subjects, as the authors' code lists them."""

    source: str
    angles_deg: tuple[float, ...]
    flexion_nm: tuple[float, ...]
    extension_nm: tuple[float, ...]

    def peak_angle_deg(self, direction: str) -> float:
        """Return the angle of the largest torque in "flexion" or "extension", degrees."""
        torques = self.flexion_nm if direction == "flexion" else self.extension_nm
        return self.angles_deg[int(np.argmax(np.abs(torques)))]


#: The two experiments of figure 3 (figures from the authors' elbow_active_torque_eval).
MEASURED = (
    DataSet(
        source="Amis et al. 1980",
        angles_deg=(0, 30, 60, 90, 120, 145),
        flexion_nm=(53, 68, 76, 70, 51, 35),
        extension_nm=(-35, -41, -51, -52, -46, -42),
    ),
    DataSet(
        source="Buchanan et al. 1998",
        angles_deg=(20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130),
        flexion_nm=(40, 44, 50, 56, 62, 69, 74, 78, 78, 75, 68, 57),
        extension_nm=(-18, -23, -30, -35, -40, -45, -48, -50, -51, -50, -47, -41),
    ),
)


@dataclass(frozen=True, kw_only=True)
class IsometricTest:
    """Torque about the elbow at full activation, shape (n,) over ANGLES_DEG, flexion positive."""

    flexion_nm: np.ndarray
    extension_nm: np.ndarray
    #: Of relaxed muscles, which both of the others contain.
    passive_nm: np.ndarray

    @property
    def flexion_peak(self) -> tuple[float, float]:
        """Largest flexion torque (Nm) and its angle (degrees)."""
        i = int(np.argmax(self.flexion_nm))
        return float(self.flexion_nm[i]), float(ANGLES_DEG[i])

    @property
    def extension_peak(self) -> tuple[float, float]:
        """Largest extension torque (Nm, negative) and its angle (degrees)."""
        i = int(np.argmin(self.extension_nm))
        return float(self.extension_nm[i]), float(ANGLES_DEG[i])


def run_isometric_test(elbow: ElbowMuscles = PAPER_MUSCLES) -> IsometricTest:
    """Contract the nominal arm's flexors, then its extensors, fully at every angle.

    The shoulder is locked at 90 degrees.
    """
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, NOMINAL_WEARER)
    add_muscles(spec, NOMINAL_WEARER, elbow=elbow)
    model = spec.compile()
    return IsometricTest(
        flexion_nm=_torques(model, elbow.flexors.muscles),
        extension_nm=_torques(model, elbow.extensors.muscles),
        passive_nm=_torques(model, ()),
    )


def _torques(model: mujoco.MjModel, contracted: tuple[Muscle, ...]) -> np.ndarray:
    """Return the elbow torque (Nm) of fully active muscles at rest, over ANGLES_DEG."""
    data = mujoco.MjData(model)
    joint = model.joint(HUMAN_JOINTS[3])
    for muscle in contracted:
        data.act[model.actuator_actadr[model.actuator(muscle.name).id]] = 1.0
    torque = np.empty(len(ANGLES_DEG))
    for i, angle in enumerate(np.radians(ANGLES_DEG)):
        data.qpos[joint.qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        torque[i] = data.qfrc_actuator[joint.dofadr[0]]
    return torque
