"""What of a URDF file a session reads: links and joints, with inertias that a body can have.

Published files hold frames between two joints without any mass, last links without inertia, and
tensors that were rounded, or mistyped, until no body has them. MuJoCo refuses each.
"""

from xml.etree import ElementTree

import numpy as np

from analysis.closeloop.errors import SessionError
from intake.xml import listed

#: kg and kg m2: what a moving link gets if it says none; nothing that is felt.
LEAST = "1e-12"
#: Share of a link's largest moment of inertia, and kg m2, by which a change of it is worth a word.
TOLD_SHARE, TOLD_INERTIA = 0.01, 1e-6
#: Least second moment of mass, over the largest: MuJoCo's own tests round.
THIN = 1e-6
#: Entries of a tensor in the file's words, by row and column.
ENTRIES = {
    "ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2),
}  # fmt: skip
#: What an element has once. Of several, readers of ROS (urdfdom) take the first, MuJoCo none.
ONCE = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"),
}


def prepare(root: ElementTree.Element, name: str) -> tuple[str, ...]:
    """Leave links and joints, without geometry, and mend inertias that no body has.

    Every link stays a body, so that a load can hang on it by its name. What else the file holds is
    for simulators and drivers (`gazebo`, `transmission`, `ros2_control`).

    Args:
        root: of the file, changed in place.
        name: of the file, for errors.

    Returns:
        What is taken otherwise than the file has it, in sentences.

    Raises:
        SessionError: a moment of inertia is missing, or below zero, or a joint's link is not there.
    """
    _check_links(root, name)
    mended, mimics, repeating = [], [], []
    for part in [*root]:
        if part.tag not in ("link", "joint"):
            root.remove(part)
        if _without_repeated(part):
            repeating.append(part.get("name", ""))
        for drawn in [*part.findall("visual"), *part.findall("collision")]:
            part.remove(drawn)
        inertia = part.find("inertial/inertia")
        if part.tag == "link" and inertia is not None and _mend(inertia, part, name):
            mended.append(part.get("name", ""))
        if part.tag == "joint" and part.find("mimic") is not None:
            mimics.append(part.get("name", ""))
    options = {"fusestatic": "false", "boundmass": LEAST, "boundinertia": LEAST}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    said = {
        "no body has the inertia of {}, which is taken as the nearest that one can have": mended,
        "<mimic> of {} is not read: the joint is where it is recorded, or at 0 if it is ignored, "
        "and the other one's motor does not move it": mimics,
        "what can be there once, as an <origin>, is there again in {}: the first counts, as in "
        "ROS, and the others are not read": repeating,
    }
    return tuple(text.format(listed(names)) for text, names in said.items() if names)


def _check_links(root: ElementTree.Element, name: str) -> None:
    """Refuse a joint between links that the file does not have; some readers add `world`.

    Raises:
        SessionError: names link and joint, and says what to add.
    """
    links = {link.get("name") for link in root.findall("link")}
    for joint in root.findall("joint"):
        for side in ("parent", "child"):
            of_joint = f"joint {joint.get('name', '')[:60]!r}"
            if (found := joint.find(side)) is None:
                raise SessionError(f'{of_joint} lacks a <{side} link="..."/>', file=name)
            link = found.get("link", "")[:60]
            if found.get("link") not in links:
                why = f"{of_joint} has the {side} link {link!r}, which the file does not declare"
                raise SessionError(f'{why}: mend the name, or add <link name="{link}"/>', file=name)


def _without_repeated(part: ElementTree.Element) -> bool:
    """Remove all but the first of what a link or joint can have once; return whether any was."""
    removed = False
    for parent in [part, *part.findall("inertial")[:1]]:
        for tag in ONCE.get(parent.tag, ()):
            for later in parent.findall(tag)[1:]:
                parent.remove(later)
                removed = True
    return removed


def _mend(inertia: ElementTree.Element, link: ElementTree.Element, name: str) -> bool:
    """Write the nearest tensor that a body can have; return whether that is another one."""
    tensor = np.zeros((3, 3))
    for key in ("ixx", "iyy", "izz"):
        if key not in inertia.attrib:
            why = f"<inertia> of link {link.get('name', '')[:60]!r} lacks {key}"
            raise SessionError(why, file=name)
    try:
        for key, (row, column) in ENTRIES.items():
            tensor[row, column] = tensor[column, row] = float(inertia.get(key, "0"))
    except ValueError:
        return False  # MuJoCo says which word is no number.
    if not np.isfinite(tensor).all():
        return False
    if (np.diag(tensor) < 0.0).any():
        why = f"<inertia> of link {link.get('name', '')[:60]!r} has a moment below 0"
        raise SessionError(why, file=name)
    nearest = consistent(tensor)
    if np.array_equal(nearest, tensor):
        return False
    for key, (row, column) in ENTRIES.items():
        inertia.set(key, repr(float(nearest[row, column])))
    change = float(np.abs(nearest - tensor).max())
    return change > max(TOLD_SHARE * float(np.abs(tensor).max()), TOLD_INERTIA)


def consistent(tensor: np.ndarray) -> np.ndarray:
    """Return the tensor of inertia that a body can have nearest to one, (3, 3), kg m2.

    Its second moments of mass, (trace / 2) 1 - tensor, have no negative eigenvalue (Traversaro,
    Brossette, Escande and Nori 2016, Identification of fully physical consistent inertial
    parameters using optimization on manifolds); those below are set to next to nothing.
    """
    moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    values, axes = np.linalg.eigh(moments)
    least = THIN * values[-1]
    if values[0] >= least:
        return tensor
    nearest = (axes * np.maximum(values, least)) @ axes.T
    return np.asarray(np.trace(nearest) * np.eye(3) - nearest)
