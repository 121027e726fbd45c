"""A device is a file: what is read from it, and what a file that cannot be is told."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.assessment.assess import assess
from sim.assessment.nominal import nominal_model
from sim.models import ASSESSMENTS
from sim.parameters.target import TARGETS
from sim.parameters.wearer import NOMINAL_WEARER
from sim.robot.control import Gains
from sim.robot.device import DEVICES, FOLDER, JOINTS, NESM, _turns, load_device
from sim.system.build import build_system
from sim.system.start import reset_to_start

ORTHOSIS = FOLDER / "elbow_orthosis.xml"


def variant(tmp_path: Path, old: str, new: str) -> str:
    """Return the path of the orthosis' file with `old` replaced by `new`."""
    text = ORTHOSIS.read_text()
    assert old in text
    path = tmp_path / "variant.xml"
    path.write_text(text.replace(old, new))
    return str(path)


def test_the_nesm_has_the_papers_joints_gains_and_limits() -> None:
    assert NESM.joints == JOINTS
    assert NESM.gains == Gains(kp=50.0, kv=15.0, ki=25.0)
    assert set(NESM.starts) == set(TARGETS)
    model = NESM.spec().compile()
    assert model.actuator_forcerange == pytest.approx(np.tile([-60.0, 60.0], (4, 1)))
    assert model.body_mass.sum() == pytest.approx(6.712 + 3.487 + 1.663 + 0.494)
    assert np.degrees(NESM.start("elbow").angles) == pytest.approx([0.0, -90.0, 0.0, 110.0])


@pytest.mark.parametrize("name", DEVICES)
def test_the_upper_arm_lies_in_its_cuff_at_every_start_of_every_device(name: str) -> None:
    device = load_device(name)
    for target in device.starts:
        system = build_system(NOMINAL_WEARER, target=TARGETS[target], device=device)
        data = reset_to_start(system)
        mujoco.mj_kinematics(system.model, data)
        cuff, _ = system.interface.cuffs
        frame = data.body(cuff.link).xmat.reshape(3, 3)
        in_world = frame @ np.column_stack([cuff.along, cuff.opening, cuff.wall])
        humerus = data.body("humerus")
        assert humerus.xmat.reshape(3, 3) == pytest.approx(in_world, abs=1e-9)
        centre = data.body(cuff.link).xpos + frame @ cuff.centre
        assert in_world.T @ (centre - humerus.xpos) == pytest.approx(cuff.limb_place, abs=1e-9)


@pytest.mark.parametrize("abduction", [-np.pi / 2, -1.2, 0.0, 1.5, np.pi / 2])
@pytest.mark.parametrize("flexion", [-2.5, 0.0, 0.4])
@pytest.mark.parametrize("rotation", [-1.0, 0.0, 3.0])
def test_the_human_joints_turns_make_the_axes_of_any_posture(
    flexion: float, abduction: float, rotation: float
) -> None:
    def axes(angles: tuple[float, ...]) -> np.ndarray:
        return Rotation.from_euler("YZX", angles).as_matrix()

    wanted = axes((flexion, abduction, rotation))
    assert axes(tuple(_turns(wanted))) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("name", DEVICES)
def test_the_declared_torque_of_every_device_is_the_slope_of_its_potential_energy(
    name: str,
) -> None:
    device = load_device(name)
    nominal = nominal_model(device)
    elbow = device.joints.index("J4")
    position = np.tile(device.start("elbow").angles, (3, 1))
    position[:, elbow] = np.radians([20.0, 60.0, 100.0])
    still = np.zeros_like(position)
    h, energies = 1e-5, []
    for shift in (-h, h):
        data = mujoco.MjData(nominal.model)
        for row in position:
            data.qpos[:] = row
            data.qpos[elbow] += shift
            mujoco.mj_fwdPosition(nominal.model, data)
            mujoco.mj_energyPos(nominal.model, data)
            energies.append(data.energy[0])
    slope = (np.array(energies[3:]) - energies[:3]) / (2 * h)
    torque = nominal.inverse_dynamics(position, still, still, elbow)
    assert torque == pytest.approx(slope, rel=1e-6)


def test_a_study_can_name_every_device() -> None:
    assert {setup.device for setup in ASSESSMENTS.values()} == set(DEVICES)


def test_only_the_cuffs_frames_count_not_those_of_their_links(tmp_path: Path) -> None:
    """The forearm's cuff on a bracket of its own, turned by 30 degrees: the same assessment."""
    sine, cosine = 0.5, 0.8660254037844387
    x, y, z = 0.15, -0.015, 0.0108
    bracket = variant(
        tmp_path,
        f'<site name="forearm_cuff" type="cylinder" size="0.036 0.03" pos="{x} {y} {z}"\n'
        '          xyaxes="0 1 0 0 0 1"/>',
        '<body name="bracket" euler="0 30 0">'
        '<inertial mass="1e-9" pos="0 0 0" diaginertia="1e-12 1e-12 1e-12"/>'
        '<site name="forearm_cuff" type="cylinder" size="0.036 0.03" '
        f'pos="{cosine * x - sine * z} {y} {sine * x + cosine * z}" '
        f'xyaxes="0 1 0 {-sine} 0 {cosine}"/></body>',
    )
    turned, plain = (assess({}, device=d, fidelity="bushing") for d in (bracket, "elbow_orthosis"))
    for name, value in plain.outputs.items():
        assert turned.outputs[name] == pytest.approx(value, rel=1e-5, abs=1e-6), name


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("<mujoco ", "<mujocco ", "is not an MJCF model"),
        ('"J4"', '"elbow"', "its joints must be J4"),
        ('motor name="J4_motor"', 'motor name="m"', "its actuators must be J4_motor, not m"),
        ('range="-20 135"', 'type="slide"', "every joint must be a hinge with a range"),
        ('name="gains" data="60 12 30"', 'name="gains" data="60 12"', 'data="kp kv ki"'),
        ('key name="elbow"', 'key name="start"', 'it needs a keyframe "elbow"'),
        ('site name="forearm_cuff"', 'site name="cuff"', 'it needs a site "forearm_cuff"'),
        ('type="cylinder" size="0.036 0.03"', 'size="0.036"', "must be a cylinder"),
        ('axis="0 -1 0"', 'axis="0 1 0"', "must flex the elbow when it grows"),
        ('pos="0.14 0 0"', 'pos="0.14 0 0.02"', "must pass through the human shoulder"),
        ('pos="0.14 0 0"', 'pos="0.14 0.05 0"', "by less than the cuff's radius"),
        (
            'pos="0.15 -0.015 0.0108"\n          xyaxes="0 1 0 0 0 1"',
            'pos="0.15 -0.015 0.0108"\n          xyaxes="0 0 1 0 1 0"',
            "both cuffs must point the same way",
        ),
    ],
)
def test_a_file_that_is_no_device_is_told_what_it_lacks(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        load_device(variant(tmp_path, old, new))


def test_unknown_devices_and_targets_a_device_lacks_are_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="unknown device 'armin': expected one of elbow_orthosis"):
        load_device("armin")
    with pytest.raises(ValueError, match="elbow_orthosis cannot assess 'shoulder_flexion'"):
        load_device("elbow_orthosis").start("shoulder_flexion")
