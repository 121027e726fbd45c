"""The 26 muscles of the authors' public model, as tables (github stesfazgi/rehyb_mujoco).

Peak forces, origins and insertions after Holzbaur et al. 2005. A row holds a muscle's name, peak
force (N), shortest and longest tendon length (m; - where formulas give them), and the points of its
path from origin to insertion: a bone's initial and a place in its frame (m).
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from sim.body.muscles.muscle import ElbowMuscles, Formula, Muscle, MuscleGroup

_BONES = {bone[0]: bone for bone in ("thorax", "clavicle", "scapula", "humerus", "ulna", "radius")}


def _read(table: str) -> tuple[Muscle, ...]:
    """Return the muscles of a table."""
    muscles = []
    for name, force, *columns in map(str.split, table.strip().splitlines()):
        shortest, longest, *path = columns
        places = zip(path[::4], path[1::4], path[2::4], path[3::4], strict=True)
        muscles.append(
            Muscle(
                name=name,
                force=float(force),
                path=tuple((_BONES[b], (float(x), float(y), float(z))) for b, x, y, z in places),
                length_range=None if shortest == "-" else (float(shortest), float(longest)),
            )
        )
    return tuple(muscles)


def _read_formulas(table: str) -> Mapping[str, tuple[Formula, Formula]]:
    """Return the formulas of a table: a name, then three coefficients of each length."""
    found = {}
    for name, *columns in map(str.split, table.strip().splitlines()):
        a, b, c, d, e, f = map(float, columns)
        found[name] = ((a, b, c), (d, e, f))
    return found


#: Shortest and longest length of each elbow muscle, m: the authors' own formulas, which they fitted
#: to lengths over 0 to 120 degrees.
_LENGTHS = _read_formulas("""
biceps_long       0.306831859 -0.038428109  0.023691288  0.309014474 0.052231842  0.023665374
biceps_short      0.286803757 -0.037001777 -0.037176130  0.289241567 0.053332948 -0.036682744
brachialis        0.115703574 -0.016340640  0.000085697  0.119759711 0.034661616  0.000016015
brachioradialis  -0.033638789  0.272108587  0.000123397  0.073070811 0.280340453  0.000004159
triceps_long      0.289885867 -0.016197458  0.014813933  0.289839325 0.030524743  0.015958815
triceps_medial    0.110253584 -0.007723165  0.000095361  0.114714821 0.032310336  0.000022633
triceps_lateral   0.217459352 -0.019397482  0.000032544  0.218874209 0.031326428  0.000011465
anconeus         -0.012068285  0.030644474  0.000074492  0.015429492 0.032207902  0.000016557
""")


# The authors give the head with the long head's path the short head's force, and the reverse.
ELBOW_FLEXORS = _read("""
biceps_long           435.6     -     -  s 0.04288 0.01401 -0.00249  h -0.0001 -0.0217 0.0011 \
                                          r 0.03809 0.00282 0.00202
biceps_short          624.3     -     -  s 0.08244 0.00915 -0.00833  r 0.03809 0.00282 0.00202
brachialis            987.3     -     -  h 0.16994 0.00421 -0.00129  u 0.03331 0.01924 0.00854
brachioradialis       261.3     -     -  h 0.21716 -0.00443 0.002  r 0.26513 0.00412 0.01037
""")
ELBOW_EXTENSORS = _read("""
triceps_long          798.5     -     -  u -0.01682 0.00657 -0.02635  s 0.03083 0.02581 -0.04169
triceps_medial        624.3     -     -  h 0.17415 0.001432 -0.00827  u -0.01771 0.02561 -0.02364
triceps_lateral       624.3     -     -  h 0.07102 -0.00863 -0.010792  u -0.02348 0.02012 -0.02043
anconeus              350.0     -     -  h 0.30395 -0.01346 -0.01568  u 0.03161 -0.00914 -0.00822
""")
#: The elbow's muscles as the authors have them, with their scales of force and operating ranges.
PAPER_MUSCLES = ElbowMuscles(
    flexors=MuscleGroup(
        muscles=tuple(replace(m, length_formulas=_LENGTHS[m.name]) for m in ELBOW_FLEXORS),
        force_scale=0.71,
        operating_range=(0.95, 1.2),
    ),
    extensors=MuscleGroup(
        muscles=tuple(replace(m, length_formulas=_LENGTHS[m.name]) for m in ELBOW_EXTENSORS),
        force_scale=1.23,
        operating_range=(0.7, 0.9),
    ),
)
SHOULDER_MUSCLES = _read("""
pectoralis_clavicular  364.4 0.067  0.22  c 0.01566 -0.07287 0.01192  h 0.07144 -0.01148 0.01682
pectoralis_sternal    515.4  0.17  0.31  t 0.16922 -0.02628 -0.07385  h 0.06748 -0.01078 0.01714
pectoralis_ribs       390.5  0.18  0.31  t 0.14595 -0.00795 0.02405  h 0.05923 -0.01111 0.0178
coracobrachialis      242.5  0.12   0.2  s 0.07924 0.01029 -0.01058  h 0.1617 0.00522 0.00501
supraspinatus         487.8 0.061  0.11  s 0.02272 0.07205 0.01412  h -0.0159 -0.01774 0.00552
deltoid_clavicular    259.9 0.028  0.19  c 0.01804 -0.13657 0.01128  h 0.10735 -0.01638 0.01038
deltoid_anterior     1142.6 0.022  0.19  s 0.00374 0.06638 0.00272  h 0.10386 -0.01451 -0.00724
deltoid_middle       1142.6 0.076  0.14  s 0.01758 -0.00783 0.00354  h 0.10267 -0.01684 -0.00097
infraspinatus        1210.8 0.085  0.13  s 0.0048 0.09815 -0.0456  h -0.01547 -0.01798 -0.00814
subscapularis        1377.8 0.068  0.11  s 0.01647 0.07893 -0.04978  h -0.0015 0.00617 0.02045
teres_minor           354.3 0.045   0.1  s 0.01249 0.05321 -0.05922  h 0.0051 -0.02655 -0.00853
teres_major           425.4 0.055   0.2  s 0.00864 0.09026 -0.10074  h 0.0695 0.0048 0.00963
latissimus_thoracic   389.1  0.17  0.26  t -0.017 -0.01 -0.10505  h 0.04118 -0.00176 0.01744
latissimus_lumbar     389.1  0.24  0.33  t -0.0002 -0.01495 -0.2249  h 0.04118 -0.00176 0.01744
latissimus_iliac      281.7  0.21   0.3  t 0.04125 -0.0903 -0.2468  h 0.04118 -0.00176 0.01744
""")
FOREARM_ROTATORS = _read("""
pronator_teres        566.2 0.072  0.11  u 0.02454 -0.0378 -0.01437  r 0.08157 -0.016 -0.04041
pronator_quadratus     75.5 0.016 0.046  u 0.226 -0.0171 -0.015  r 0.21322 0.0 -0.015
supinator             476.0  0.05 0.067  u 0.05441 -0.01 -0.00598  r 0.09092 -0.01699 0.0169
""")
#: Muscles that co-contract, by what `sim.parameters.target.Target.muscles` may be.
CO_CONTRACTING: Mapping[str, tuple[Muscle, ...]] = MappingProxyType(
    {"elbow": ELBOW_FLEXORS + ELBOW_EXTENSORS, "shoulder": SHOULDER_MUSCLES}
)
