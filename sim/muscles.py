"""The muscles of shoulder, elbow and forearm (paper, section 2.2.1 and equation 17).

Peak forces, origins and insertions are facts of the authors' public model (github
stesfazgi/rehyb_mujoco), after Holzbaur et al. 2005: forces in N, points in m, in the frame of the
bone they name. The scaling of the elbow's peak forces and its operating ranges were fitted by the
authors to the isometric torques of Amis et al. 1980 and Buchanan et al. 1998;
`sim.validation.isometric` checks them here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from math import radians

import mujoco
import numpy as np

from sim.skeleton import (
    HUMAN_JOINTS,
    add_arm,
    add_torso,
    empty_spec,
    forearm_point,
    upper_arm_point,
)
from sim.wearer import NOMINAL_WEARER, Wearer

#: A point of a muscle's path: bone and position in its frame, m.
Point = tuple[str, tuple[float, float, float]]


@dataclass(frozen=True, kw_only=True)
class Muscle:
    """One muscle-tendon unit."""

    name: str
    #: Peak active force before the group's scaling, N.
    force: float
    #: Path from origin to insertion, straight between points.
    path: tuple[Point, ...]
    #: Shortest and longest tendon length, m; None: swept from the elbow's motion.
    length_range: tuple[float, float] | None = None
    #: Optimal lengths at both; None: the group's.
    operating_range: tuple[float, float] | None = None
    #: Whether the last part of the path wraps round the trochlea.
    wraps: bool = False


def _two_point(
    name: str,
    force: float,
    length_range: tuple[float, float],
    origin: Point,
    insertion: Point,
) -> Muscle:
    return Muscle(name=name, force=force, path=(origin, insertion), length_range=length_range)


ELBOW_FLEXORS = (
    # The authors give the head with the long head's path the short head's force, and the reverse.
    Muscle(
        name="biceps_long",
        force=435.6,
        path=(
            ("scapula", (0.04288, 0.01401, -0.00249)),
            ("humerus", (-0.0001, -0.0217, 0.0011)),
            ("radius", (0.03809, 0.00282, 0.00202)),
        ),
    ),
    Muscle(
        name="biceps_short",
        force=624.3,
        path=(
            ("scapula", (0.08244, 0.00915, -0.00833)),
            ("radius", (0.03809, 0.00282, 0.00202)),
        ),
    ),
    Muscle(
        name="brachialis",
        force=987.3,
        path=(("humerus", (0.16994, 0.00421, -0.00129)), ("ulna", (0.03331, 0.01924, 0.00854))),
    ),
    Muscle(
        name="brachioradialis",
        force=261.3,
        path=(("humerus", (0.21716, -0.00443, 0.002)), ("radius", (0.26513, 0.00412, 0.01037))),
    ),
)

ELBOW_EXTENSORS = (
    Muscle(
        name="triceps_long",
        force=798.5,
        path=(("ulna", (-0.01682, 0.00657, -0.02635)), ("scapula", (0.03083, 0.02581, -0.04169))),
    ),
    Muscle(
        name="triceps_medial",
        force=624.3,
        path=(("humerus", (0.17415, 0.001432, -0.00827)), ("ulna", (-0.01771, 0.02561, -0.02364))),
    ),
    Muscle(
        name="triceps_lateral",
        force=624.3,
        path=(("humerus", (0.07102, -0.00863, -0.010792)), ("ulna", (-0.02348, 0.02012, -0.02043))),
    ),
    Muscle(
        name="anconeus",
        force=350.0,
        path=(("humerus", (0.30395, -0.01346, -0.01568)), ("ulna", (0.03161, -0.00914, -0.00822))),
    ),
)

_T, _C, _S, _H = "thorax", "clavicle", "scapula", "humerus"
SHOULDER_MUSCLES = (
    _two_point(
        "pectoralis_clavicular", 364.4, (0.067, 0.22),
        (_C, (0.01566, -0.07287, 0.01192)), (_H, (0.07144, -0.01148, 0.01682)),
    ),
    _two_point(
        "pectoralis_sternal", 515.4, (0.17, 0.31),
        (_T, (0.16922, -0.02628, -0.07385)), (_H, (0.06748, -0.01078, 0.01714)),
    ),
    _two_point(
        "pectoralis_ribs", 390.5, (0.18, 0.31),
        (_T, (0.14595, -0.00795, 0.02405)), (_H, (0.05923, -0.01111, 0.0178)),
    ),
    _two_point(
        "coracobrachialis", 242.5, (0.12, 0.2),
        (_S, (0.07924, 0.01029, -0.01058)), (_H, (0.1617, 0.00522, 0.00501)),
    ),
    _two_point(
        "supraspinatus", 487.8, (0.061, 0.11),
        (_S, (0.02272, 0.07205, 0.01412)), (_H, (-0.0159, -0.01774, 0.00552)),
    ),
    _two_point(
        "deltoid_clavicular", 259.9, (0.028, 0.19),
        (_C, (0.01804, -0.13657, 0.01128)), (_H, (0.10735, -0.01638, 0.01038)),
    ),
    _two_point(
        "deltoid_anterior", 1142.6, (0.022, 0.19),
        (_S, (0.00374, 0.06638, 0.00272)), (_H, (0.10386, -0.01451, -0.00724)),
    ),
    _two_point(
        "deltoid_middle", 1142.6, (0.076, 0.14),
        (_S, (0.01758, -0.00783, 0.00354)), (_H, (0.10267, -0.01684, -0.00097)),
    ),
    _two_point(
        "infraspinatus", 1210.8, (0.085, 0.13),
        (_S, (0.0048, 0.09815, -0.0456)), (_H, (-0.01547, -0.01798, -0.00814)),
    ),
    _two_point(
        "subscapularis", 1377.8, (0.068, 0.11),
        (_S, (0.01647, 0.07893, -0.04978)), (_H, (-0.0015, 0.00617, 0.02045)),
    ),
    _two_point(
        "teres_minor", 354.3, (0.045, 0.1),
        (_S, (0.01249, 0.05321, -0.05922)), (_H, (0.0051, -0.02655, -0.00853)),
    ),
    _two_point(
        "teres_major", 425.4, (0.055, 0.2),
        (_S, (0.00864, 0.09026, -0.10074)), (_H, (0.0695, 0.0048, 0.00963)),
    ),
    _two_point(
        "latissimus_thoracic", 389.1, (0.17, 0.26),
        (_T, (-0.017, -0.01, -0.10505)), (_H, (0.04118, -0.00176, 0.01744)),
    ),
    _two_point(
        "latissimus_lumbar", 389.1, (0.24, 0.33),
        (_T, (-0.0002, -0.01495, -0.2249)), (_H, (0.04118, -0.00176, 0.01744)),
    ),
    _two_point(
        "latissimus_iliac", 281.7, (0.21, 0.3),
        (_T, (0.04125, -0.0903, -0.2468)), (_H, (0.04118, -0.00176, 0.01744)),
    ),
)  # fmt: skip

FOREARM_ROTATORS = (
    _two_point(
        "pronator_teres", 566.2, (0.072, 0.11),
        ("ulna", (0.02454, -0.0378, -0.01437)), ("radius", (0.08157, -0.016, -0.04041)),
    ),
    _two_point(
        "pronator_quadratus", 75.5, (0.016, 0.046),
        ("ulna", (0.226, -0.0171, -0.015)), ("radius", (0.21322, 0.0, -0.015)),
    ),
    _two_point(
        "supinator", 476.0, (0.05, 0.067),
        ("ulna", (0.05441, -0.01, -0.00598)), ("radius", (0.09092, -0.01699, 0.0169)),
    ),
)  # fmt: skip

#: Authors' fit to the isometric tests: scaling of peak force, operating range in optimal lengths.
FLEXOR_FORCE_SCALE, FLEXOR_RANGE = 0.71, (0.95, 1.2)
EXTENSOR_FORCE_SCALE, EXTENSOR_RANGE = 1.23, (0.7, 0.9)
#: MuJoCo's default operating range, which the other muscles keep.
DEFAULT_RANGE = (0.75, 1.05)
#: Elbow angles over which an elbow muscle's shortest and longest lengths are searched.
SWEEP = np.radians(np.linspace(0.0, 120.0, 25))

_TENDON_COLOURS = {
    "flexor": (0.8, 0.15, 0.15, 1),
    "extensor": (0.2, 0.5, 0.8, 1),
    "other": (0.7, 0.4, 0.4, 1),
}


def add_muscles(
    spec: mujoco.MjSpec,
    wearer: Wearer,
    *,
    wrapped: bool = False,
    others: tuple[Muscle, ...] = SHOULDER_MUSCLES + FOREARM_ROTATORS,
) -> None:
    """Add muscles to a spec that has torso and arm, 26 in all; their input is activation, 0 to 1.

    Args:
        spec: the model under construction.
        wearer: whose arm it is.
        wrapped: whether the triceps wraps round the elbow (`sim.triceps`) or is straight lines.
        others: muscles beside the elbow's.
    """
    extensors: tuple[Muscle, ...] = ELBOW_EXTENSORS
    extensor_scale = EXTENSOR_FORCE_SCALE
    if wrapped:
        from sim.triceps import FORCE_SCALE, WRAPPED_EXTENSORS, add_trochlea

        extensors, extensor_scale = WRAPPED_EXTENSORS, FORCE_SCALE
        add_trochlea(spec, wearer)
    beside = tuple(muscle for muscle in others if muscle.length_range)
    ranges = elbow_length_ranges(wearer, wrapped=wrapped)
    for group, muscles, scale, operating_range in (
        ("flexor", ELBOW_FLEXORS, FLEXOR_FORCE_SCALE, FLEXOR_RANGE),
        ("extensor", extensors, extensor_scale, EXTENSOR_RANGE),
        ("other", beside, 1.0, DEFAULT_RANGE),
    ):
        for muscle in muscles:
            _add_path(spec, muscle, wearer, _TENDON_COLOURS[group])
            actuator = spec.add_actuator(
                name=muscle.name,
                trntype=mujoco.mjtTrn.mjTRN_TENDON,
                target=muscle.name,
                ctrllimited=True,
                ctrlrange=[0.0, 1.0],
                lengthrange=list(muscle.length_range or ranges[muscle.name]),
            )
            actuator.set_to_muscle(
                tausmooth=0.0,
                force=scale * muscle.force,
                range=list(muscle.operating_range or operating_range),
            )


def elbow_length_ranges(wearer: Wearer, *, wrapped: bool = False) -> dict[str, tuple[float, float]]:
    """Return each elbow muscle's shortest and longest length (m) over 0 to 120 degrees of flexion.

    The shoulder is flexed to 90 degrees, as in the isometric tests that the operating ranges were
    fitted to. Only the two lengths of the wearer matter.
    """
    return dict(_swept_ranges(wearer.upper_arm_length, wearer.forearm_length, wrapped))


@cache
def _swept_ranges(
    upper_arm_length: float, forearm_length: float, wrapped: bool
) -> tuple[tuple[str, tuple[float, float]], ...]:
    wearer = Wearer(
        **{
            **vars(NOMINAL_WEARER),
            "upper_arm_length": upper_arm_length,
            "forearm_length": forearm_length,
        }
    )
    muscles: tuple[Muscle, ...] = ELBOW_FLEXORS + ELBOW_EXTENSORS
    if wrapped:
        from sim.triceps import WRAPPED_EXTENSORS

        muscles = ELBOW_FLEXORS + WRAPPED_EXTENSORS
    lengths = np.empty((len(SWEEP), len(muscles)))
    straight = [i for i, muscle in enumerate(muscles) if not muscle.wraps]
    lengths[:, straight] = _straight_lengths(wearer, [muscles[i] for i in straight])
    round_the_elbow = [i for i, muscle in enumerate(muscles) if muscle.wraps]
    if round_the_elbow:
        lengths[:, round_the_elbow] = _wrapped_lengths(
            wearer, [muscles[i] for i in round_the_elbow]
        )
    return tuple(
        (m.name, (float(lengths[:, i].min()), float(lengths[:, i].max())))
        for i, m in enumerate(muscles)
    )


def _straight_lengths(wearer: Wearer, muscles: list[Muscle]) -> np.ndarray:
    """Return the lengths of straight paths over SWEEP, m, shape (angles, muscles).

    A model need not be compiled for them: bones keep their directions when an arm is scaled.
    """
    places = {}
    for bone, (place, frame) in _nominal_poses().items():
        if bone == "ulna":
            place = wearer.upper_arm_scale * place
        elif bone == "radius":
            ulna = _nominal_poses()["ulna"][0]
            place = wearer.upper_arm_scale * ulna + wearer.forearm_scale * (place - ulna)
        places[bone] = place, frame
    lengths = np.empty((len(SWEEP), len(muscles)))
    for i, muscle in enumerate(muscles):
        path = np.stack(
            [places[b][0] + places[b][1] @ on_wearer(b, p, wearer) for b, p in muscle.path], axis=1
        )
        lengths[:, i] = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(axis=1)
    return lengths


@cache
def _nominal_poses() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return place (angles, 3) and axes (angles, 3, 3) of the nominal bones over SWEEP."""
    model = _bare_arm(NOMINAL_WEARER).compile()
    data = mujoco.MjData(model)
    bones = {bone: model.body(bone).id for bone in ("scapula", "humerus", "ulna", "radius")}
    poses = {bone: (np.empty((len(SWEEP), 3)), np.empty((len(SWEEP), 3, 3))) for bone in bones}
    for i in _sweep(model, data):
        for bone, number in bones.items():
            poses[bone][0][i] = data.xpos[number]
            poses[bone][1][i] = data.xmat[number].reshape(3, 3)
    return poses


def _wrapped_lengths(wearer: Wearer, muscles: list[Muscle]) -> np.ndarray:
    """Return the lengths of paths round the trochlea over SWEEP, m, shape (angles, muscles)."""
    from sim.triceps import add_trochlea

    spec = _bare_arm(wearer)
    add_trochlea(spec, wearer)
    for muscle in muscles:
        _add_path(spec, muscle, wearer, _TENDON_COLOURS["other"])
    model = spec.compile()
    data = mujoco.MjData(model)
    lengths = np.empty((len(SWEEP), model.ntendon))
    for i in _sweep(model, data):
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        lengths[i] = data.ten_length
    return lengths


def _bare_arm(wearer: Wearer) -> mujoco.MjSpec:
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, wearer)
    return spec


def _sweep(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[int]:
    """Bend the elbow through SWEEP with the shoulder flexed; yield the number of each angle."""
    elbow = model.joint(HUMAN_JOINTS[3]).qposadr[0]
    data.qpos[model.joint(HUMAN_JOINTS[1]).qposadr[0]] = radians(-90.0)
    for i, angle in enumerate(SWEEP):
        data.qpos[elbow] = angle
        mujoco.mj_kinematics(model, data)
        yield i


def _add_path(
    spec: mujoco.MjSpec,
    muscle: Muscle,
    wearer: Wearer,
    rgba: tuple[float, float, float, float],
) -> None:
    tendon = spec.add_tendon(name=muscle.name, width=0.002, rgba=list(rgba))
    for i, (bone, point) in enumerate(muscle.path, start=1):
        site = f"{muscle.name}_{i}"
        spec.body(bone).add_site(name=site, pos=on_wearer(bone, point, wearer), size=[0.003] * 3)
        if muscle.wraps and i == len(muscle.path):
            tendon.wrap_geom("trochlea", "behind_trochlea")
        tendon.wrap_site(site)


def on_wearer(bone: str, point: tuple[float, float, float], wearer: Wearer) -> np.ndarray:
    """Return a point (m, in the frame of its bone) of the wearer's arm."""
    if bone == "humerus":
        return upper_arm_point(wearer, point)
    if bone in ("ulna", "radius"):
        return forearm_point(wearer, point)
    return np.asarray(point)
