"""Shortest and longest lengths of the elbow's muscles on a wearer's bones, in closed form.

MuJoCo could sweep them, but only in a compiled arm for each wearer, which takes as long as a
quarter of an assessment without contact; a test compares the two.
"""

from copy import copy
from functools import cache, lru_cache
from math import radians

import mujoco
import numpy as np

from sim.body.muscles.muscle import ElbowMuscles, Formula, Muscle, MuscleGroup, Wrap
from sim.body.skeleton import (
    ELBOW,
    HUMAN_JOINTS,
    HUMERUS_SHRINK,
    add_arm,
    add_torso,
    bone_point,
    empty_spec,
    upper_arm_point,
)
from sim.parameters.wearer import NOMINAL_WEARER, Wearer

#: Elbow angles over which an elbow muscle's shortest and longest lengths are searched.
SWEEP = np.radians(np.linspace(0.0, 120.0, 25))
#: Columns of a point in the frame of the humerus: across a cylinder's axis, and along it.
_ACROSS, _ALONG = [0, 2], 1

#: Places (angles, 3) and axes (angles, 3, 3) of bones in the world, over SWEEP.
Poses = dict[str, tuple[np.ndarray, np.ndarray]]


def elbow_length_ranges(wearer: Wearer, elbow: ElbowMuscles) -> dict[str, tuple[float, float]]:
    """Return each elbow muscle's shortest and longest length (m) over 0 to 120 degrees of flexion.

    The shoulder is flexed to 90 degrees, as in the isometric tests that the operating ranges were
    fitted to. Only the lengths of the wearer matter, and where its elbow is.
    """
    kept = {n: v for n, v in vars(wearer).items() if n.endswith("_length") or n == "elbow_offset"}
    return dict(_ranges(Wearer(**kept), elbow))


def elbow_lengths(wearer: Wearer, elbow: ElbowMuscles) -> dict[str, np.ndarray]:
    """Return the length of each elbow muscle's path over SWEEP, m, shape (angles,)."""
    muscles, poses = elbow.flexors.muscles + elbow.extensors.muscles, _poses(wearer)
    return {muscle.name: _lengths(muscle, wearer, poses) for muscle in muscles}


def operating_range(muscle: Muscle, group: MuscleGroup, elbow: ElbowMuscles) -> tuple[float, float]:
    """Return a muscle's fibre lengths at its shortest and longest, in optimal ones.

    Published fibres decide them at the nominal wearer; they scale with a wearer's lengths.
    """
    fibres = muscle.fibres
    if fibres is None:
        return muscle.operating_range or group.operating_range
    shortest, longest = elbow_length_ranges(NOMINAL_WEARER, elbow)[muscle.name]
    straight = (fibres.extended - fibres.slack) / fibres.optimal
    excursion = (longest - shortest) / fibres.optimal
    # Flexors are longest while the elbow is straight, extensors shortest.
    if group is elbow.flexors:
        return straight - excursion, straight
    return straight, straight + excursion


# Most wearers of a design's row have the same lengths.
@lru_cache(maxsize=256)
def _ranges(wearer: Wearer, elbow: ElbowMuscles) -> tuple[tuple[str, tuple[float, float]], ...]:
    poses = _poses(wearer)
    found = []
    for muscle in elbow.flexors.muscles + elbow.extensors.muscles:
        if muscle.length_formulas:
            shortest, longest = (_value(formula, wearer) for formula in muscle.length_formulas)
        else:
            lengths = _lengths(muscle, wearer, poses)
            shortest, longest = float(lengths.min()), float(lengths.max())
        found.append((muscle.name, (shortest, longest)))
    return tuple(found)


def _value(formula: Formula, wearer: Wearer) -> float:
    """Return a published length, m; its upper arm is measured on the authors' drawn humerus."""
    upper, fore, constant = formula
    return upper * HUMERUS_SHRINK * wearer.upper_arm_scale + fore * wearer.forearm_scale + constant


def _lengths(muscle: Muscle, wearer: Wearer, poses: Poses) -> np.ndarray:
    """Return the length of a muscle's path over SWEEP, m."""
    points = [
        poses[bone][0] + poses[bone][1] @ bone_point(wearer, bone, point)
        for bone, point in muscle.path
    ]
    parts = np.linalg.norm(np.diff(points, axis=0), axis=2)
    if muscle.wrap:
        part = muscle.wrap.part
        parts[part] = _length_round(muscle.wrap, points[part], points[part + 1], wearer, poses)
    total: np.ndarray = parts.sum(axis=0)
    return total


def _length_round(
    wrap: Wrap, origin: np.ndarray, insertion: np.ndarray, wearer: Wearer, poses: Poses
) -> np.ndarray:
    """Return the shortest way between two points that passes a cylinder on its side, m.

    Unrolled, the way round a cylinder is straight: two tangents and an arc across the axis, and
    what the points are apart along it.

    Args:
        wrap: the cylinder.
        origin: in the world, m, shape (angles, 3).
        insertion: of that shape.
        wearer: whose arm it is.
        poses: of its bones.
    """
    bone, place = wrap.centre
    where, axes = poses[bone]
    centre, radius = bone_point(wearer, bone, place), wrap.radius * wearer.upper_arm_scale
    # Row vectors times the axes of the humerus: the world seen from there.
    a, b = ((((p - where)[:, None] @ axes)[:, 0] - centre) for p in (origin, insertion))
    along = (b - a)[:, _ALONG]
    a, b = a[:, _ACROSS], b[:, _ACROSS]
    straight = np.linalg.norm(b - a, axis=1)
    far_a, far_b = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    # To MuJoCo a point within the cylinder is not held off by it.
    outside = np.minimum(far_a, far_b) > radius
    far_a, far_b = np.maximum(far_a, radius), np.maximum(far_b, radius)
    apart = np.abs(_angle(a, wrap) - _angle(b, wrap))
    turned = apart - np.arccos(radius / far_a) - np.arccos(radius / far_b)
    # Not below zero by rounding, where a point is no farther than the radius.
    tangents = sum(np.sqrt(np.maximum(far**2 - radius**2, 0.0)) for far in (far_a, far_b))
    # A straight way on that side needs no arc.
    across = np.where(outside & (turned > 0.0), tangents + radius * turned, straight)
    return np.asarray(np.hypot(across, along))


def _angle(points: np.ndarray, wrap: Wrap) -> np.ndarray:
    """Return the angle of points across a cylinder's axis, from the side that is passed, rad."""
    x, z = points.T
    along, across = wrap.side
    return np.asarray(np.arctan2(along * z - across * x, along * x + across * z))


def _poses(wearer: Wearer) -> Poses:
    """Return the poses of a wearer's bones: they keep their directions when an arm is scaled."""
    nominal = _nominal_poses(wearer.elbow_offset)
    elbow, wrist = nominal["ulna"], nominal["radius"]
    ulna = wearer.upper_arm_scale * elbow[0]
    radius = ulna + wearer.forearm_scale * (wrist[0] - elbow[0])
    return {**nominal, "ulna": (ulna, elbow[1]), "radius": (radius, wrist[1])}


@cache
def _nominal_arm() -> mujoco.MjModel:
    """Return the nominal wearer's bones."""
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, NOMINAL_WEARER)
    return spec.compile()


def _nominal_poses(elbow_offset: float) -> Poses:
    """Return the poses of the nominal wearer's bones, its elbow that far off, m."""
    model = copy(_nominal_arm())
    model.body("ulna").pos = upper_arm_point(Wearer(elbow_offset=elbow_offset), ELBOW)
    data = mujoco.MjData(model)
    bones = {bone: model.body(bone).id for bone in ("scapula", "humerus", "ulna", "radius")}
    poses = {bone: (np.empty((len(SWEEP), 3)), np.empty((len(SWEEP), 3, 3))) for bone in bones}
    data.joint(HUMAN_JOINTS[1]).qpos = radians(-90.0)
    elbow = data.joint(HUMAN_JOINTS[3])
    for i, angle in enumerate(SWEEP):
        elbow.qpos = angle
        mujoco.mj_kinematics(model, data)
        for bone, number in bones.items():
            poses[bone][0][i] = data.xpos[number]
            poses[bone][1][i] = data.xmat[number].reshape(3, 3)
    return poses
