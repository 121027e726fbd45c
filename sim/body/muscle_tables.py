"""The 26 muscles of the authors' public model, as tables (github stesfazgi/rehyb_mujoco).

Peak forces, origins and insertions after Holzbaur et al. 2005: forces in N, points in m, in the
frame of the bone they name.
"""

from dataclasses import dataclass

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


#: MuJoCo's defaults: operating range, shortest active length, passive force.
DEFAULT_RANGE, DEFAULT_SHORTEST_ACTIVE, DEFAULT_PASSIVE_FORCE = (0.75, 1.05), 0.5, 1.3


@dataclass(frozen=True, kw_only=True)
class MuscleGroup:
    """Muscles with what they have in common; lengths in optimal ones."""

    muscles: tuple[Muscle, ...]
    #: What their peak forces are multiplied by.
    force_scale: float = 1.0
    #: Lengths at the two ends of the length range.
    operating_range: tuple[float, float] = DEFAULT_RANGE
    #: Length at which active force vanishes.
    shortest_active: float = DEFAULT_SHORTEST_ACTIVE
    #: Passive force at 1.6 optimal lengths, over peak force.
    passive_force: float = DEFAULT_PASSIVE_FORCE


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
