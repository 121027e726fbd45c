"""Cuffs: half cylinders of welded boxes that open medially (paper, section 2.2.3, figure 5)."""

from dataclasses import replace
from math import pi, tan

import mujoco
import numpy as np

from sim.parameters.conditions import Conditions
from sim.robot.cuff import Cuff

#: Boxes of a cuff, which span half a circle, and the angle of each from the opening, rad.
BOXES = 6
BOX_ANGLES = [pi / 2 + (i + 0.5) * pi / BOXES for i in range(BOXES)]
CUFF_THICKNESS = 0.030
#: Body and joint of the slide.
SLIDE = "forearm_cuff_slide"
#: A cuff on a slide: inertia, kg, and damping, N s/m.
SLIDE_INERTIA, SLIDE_DAMPING = 1.0, 20.0


def place_cuffs(own: tuple[Cuff, Cuff], conditions: Conditions) -> tuple[Cuff, Cuff]:
    """Return a device's `own` cuffs of upper arm and forearm where the conditions put them."""
    upper_arm = own[0].moved(conditions.upper_cuff_position)
    forearm = own[1].moved(conditions.cuff_position)
    slides = conditions.cuff_compliance > 0.0
    return upper_arm, replace(forearm, link=SLIDE if slides else forearm.link)


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


def add_cuff(spec: mujoco.MjSpec, cuff: Cuff) -> None:
    """Add the cuff's boxes to its link."""
    link = spec.body(cuff.link)
    half_width = (cuff.radius + CUFF_THICKNESS) * tan(pi / BOXES / 2)
    for i, angle in enumerate(BOX_ANGLES):
        centre = np.array(cuff.centre) + (cuff.radius + CUFF_THICKNESS / 2) * cuff.normal(angle)
        add_box(
            link,
            cuff_box_name(cuff, i),
            centre,
            frame=cuff.box_frame(angle),
            size=[half_width, CUFF_THICKNESS / 2, cuff.length / 2],
            mass=0.0,
            rgba=(0.2, 0.45, 0.75, 0.45),
        )


def quaternion(axes: np.ndarray) -> np.ndarray:
    """Return the quaternion, (4,), of a frame whose axes are the columns of `axes`, (3, 3)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    return quat


def add_box(
    body: mujoco.MjsBody,
    name: str,
    centre: np.ndarray,
    *,
    frame: np.ndarray,
    size: list[float],
    mass: float,
    rgba: tuple[float, float, float, float],
) -> None:
    """Add a box that belongs to a cuff or strap; `frame` has its axes as columns."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        quat=quaternion(frame),
        size=size,
        mass=mass,
        rgba=list(rgba),
        group=1,
        contype=0,
        conaffinity=0,
    )
