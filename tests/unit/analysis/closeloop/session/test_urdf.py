"""Inertias of published URDF files: read as a body can have them, and told where that is new."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.urdf import consistent, prepare

LINK = """<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}"
  izz="{zz}" ixy="{xy}" ixz="0" iyz="0"/></inertial></link>"""


def arm(tip: str) -> ElementTree.Element:
    """Return an arm of two joints with a frame between them that has no mass."""
    return ElementTree.fromstring(f"""<robot name="arm">
      <link name="base"/><link name="between"/>{tip}
      <joint name="first" type="continuous"><parent link="base"/><child link="between"/></joint>
      <joint name="second" type="continuous"><parent link="between"/><child link="tip"/>
        <axis xyz="0 1 0"/></joint></robot>""")


def link(xx: float, yy: float, zz: float, xy: float = 0.0, mass: float = 0.2) -> str:
    return LINK.format(name="tip", mass=mass, xx=xx, yy=yy, zz=zz, xy=xy)


def moments(root: ElementTree.Element) -> np.ndarray:
    """Return the tip's principal moments as MuJoCo reads them, largest first."""
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    return np.asarray(spec.compile().body("tip").inertia)


def test_links_without_mass_or_inertia_move_and_weigh_nothing() -> None:
    root = arm(link(0.0, 0.0, 0.0))
    assert prepare(root, "arm.urdf") == ()
    assert moments(root) == pytest.approx([0.0, 0.0, 0.0], abs=1e-8)


def test_a_tensor_that_no_body_has_becomes_the_nearest_that_one_can_have_and_is_told() -> None:
    root = arm(link(1.0, 1.0, 3.0))
    (remark,) = prepare(root, "arm.urdf")
    assert remark.startswith("no body has the inertia of tip, ")
    # Second moments of mass 1.5, 1.5 and -0.5, of which the last is set to zero.
    assert moments(root) == pytest.approx([3.0, 1.5, 1.5], rel=1e-5)


def test_a_thin_rod_is_read() -> None:
    root = arm(link(0.0, 0.1, 0.1))
    assert prepare(root, "arm.urdf") == ()
    assert moments(root) == pytest.approx([0.1, 0.1, 0.0], abs=1e-6)


def test_an_antennas_nonsense_is_read_and_is_not_worth_a_word() -> None:
    """As of the mobile base of TIAGo: a milligram's products of inertia larger than its moments."""
    root = arm(link(2.371e-8, 2.833e-8, 3.849e-8, xy=6.119e-8, mass=1e-6))
    assert prepare(root, "arm.urdf") == ()
    moments(root)


def test_what_a_body_can_have_stays_to_the_last_digit() -> None:
    turned = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    whole = turned @ np.diag([0.1, 0.2, 0.25]) @ turned.T
    assert consistent(whole) is whole
    root = arm(link(0.1, 0.2, 0.25))
    before = ElementTree.tostring(root.find("link[@name='tip']/inertial/inertia"))
    assert prepare(root, "arm.urdf") == ()
    assert ElementTree.tostring(root.find("link[@name='tip']/inertial/inertia")) == before


def test_a_moment_below_zero_is_refused_with_its_link() -> None:
    with pytest.raises(
        SessionError, match=r"arm\.urdf: <inertia> of link 'tip' has a moment below"
    ):
        prepare(arm(link(-0.1, 0.2, 0.25)), "arm.urdf")


def test_a_missing_moment_is_refused_and_not_read_as_none() -> None:
    root = arm(link(0.1, 0.2, 0.25).replace('ixx="0.1" ', ""))
    with pytest.raises(SessionError, match=r"arm\.urdf: <inertia> of link 'tip' lacks ixx"):
        prepare(root, "arm.urdf")


def test_a_joint_that_mimics_another_is_told_of() -> None:
    root = arm(link(0.1, 0.2, 0.25))
    ElementTree.SubElement(root.find("joint[@name='second']"), "mimic", joint="first")  # type: ignore[arg-type]
    (remark,) = prepare(root, "arm.urdf")
    assert remark.startswith("<mimic> of second is not read")


def test_of_two_origins_the_first_counts_and_the_joint_is_told() -> None:
    """As in a stranger's KUKA LWR: a mount that was moved, and its old place left below it."""
    root = arm(link(0.1, 0.2, 0.25))
    joint = root.find("joint[@name='second']")
    assert joint is not None
    joint.insert(0, ElementTree.fromstring('<origin xyz="0 0 1"/>'))
    ElementTree.SubElement(joint, "origin", xyz="0 0 0")
    inertial = root.find("link[@name='tip']/inertial")
    assert inertial is not None
    ElementTree.SubElement(inertial, "mass", value="7")
    (remark,) = prepare(root, "arm.urdf")
    assert "again in tip, second: the first counts" in remark
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    tip = spec.compile().body("tip")
    assert list(tip.pos) == [0.0, 0.0, 1.0] and tip.mass == pytest.approx(0.2)


def test_a_joint_whose_link_is_not_declared_is_named_with_what_to_add() -> None:
    """A stranger's `world` was a "child missing Element 'joint'"."""
    root = arm(link(1.0, 1.0, 1.0))
    first = root.find("joint[@name='first']/parent")
    assert first is not None
    first.set("link", "world")
    with pytest.raises(SessionError) as caught:
        prepare(root, "arm.urdf")
    said = str(caught.value)
    assert "joint 'first' has the parent link 'world', which the file does not declare" in said
    assert 'add <link name="world"/>' in said


def test_a_joint_without_a_child_is_named() -> None:
    root = arm(link(1.0, 1.0, 1.0))
    joint = root.find("joint[@name='second']")
    assert joint is not None
    joint.remove(joint.findall("child")[0])
    with pytest.raises(SessionError, match="joint 'second' lacks a <child link="):
        prepare(root, "arm.urdf")
