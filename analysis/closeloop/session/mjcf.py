"""Load the model of a session: an open chain in MJCF or URDF; what reaches further is refused.

Geometry is left out: inverse dynamics needs inertias only, and a session's folder has no meshes.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session import urdf
from analysis.closeloop.session.bounds import check_bounds
from analysis.closeloop.session.contents import NOMINAL, Session
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.files import SESSION_FILE, inside, read_text
from intake.xml import XmlError, listed, parse_model
from sim.assessment.nominal import nominal_spec
from sim.effects.elements import without_applied

MAX_MODEL_BYTES = 5_000_000
#: Elements and attributes of an MJCF file that reach outside it or break an open chain.
REFUSED_ELEMENTS = {
    "include": "an included file",
    "plugin": "a plugin",
    "extension": "a plugin",
    "freejoint": "a free joint",
    "attach": "an attached model",
    "model": "an attached model",
    "equality": "an equality constraint, which closes the chain",
    "replicate": "a generator of bodies",
    "composite": "a generator of bodies",
    "flexcomp": "a generator of bodies",
    "flex": "a deformable body",
}
#: What no body has less than nothing of, though MuJoCo lifts or ignores it in some places.
NEVER_NEGATIVE = ("mass", "density", "diaginertia")
#: Assets that only draw, or come from a file.
DRAWN = ("mesh", "hfield", "texture", "material", "skin")


def load_device(session: Session) -> Device:
    """Load the session's model and check every name in `session.json` against it.

    Raises:
        SessionError: the model cannot be used, or a name is not in it.
    """
    remarks: tuple[str, ...] = ()
    if session.model == NOMINAL:
        spec = nominal_spec(height_m=session.height_m, mass_kg=session.mass_kg)
    else:
        path = inside(session.folder, session.model, field_name="model")
        spec, remarks = _read_model(path, session.model)
    if session.gravity is not None:
        spec.option.gravity = session.gravity
    device = Device(
        spec=spec,
        ignored_joints=session.ignored_joints,
        unread_effects=tuple(without_applied(spec)),
        remarks=remarks,
    )
    try:
        joint_types = device.model.jnt_type
    except ValueError as error:
        raise _refused(error, session.model) from None
    kinds = {mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE}
    if any(mujoco.mjtJoint(joint_type) not in kinds for joint_type in joint_types):
        raise SessionError("may have hinge and slide joints only", file=session.model)
    check_bounds(device.model, session.model)
    _check_losses(device.model, session.model)
    if not device.joints or not all(device.joints):
        raise SessionError("must have joints, each with a name", file=session.model)
    _check_names(session, device)
    if not device.recorded_joints:
        raise SessionError("ignored_joints leaves no joint to analyse", file=SESSION_FILE)
    return device


def check_model(path: Path) -> None:
    """Raise a SessionError if a model's file is one that no session can have."""
    whole = path.resolve()
    load_device(Session(folder=whole.parent, model=whole.name))


def _check_losses(model: mujoco.MjModel, name: str) -> None:
    """Refuse a joint that gains energy by moving, or has less inertia than none.

    Raises:
        SessionError: names the joint.
    """
    for word, numbers in (
        ("damping", model.dof_damping),
        ("frictionloss", model.dof_frictionloss),
        ("armature", model.dof_armature),
    ):
        worst = int(np.argmin(numbers)) if len(numbers) else 0
        if len(numbers) and numbers[worst] < 0.0:
            joint = model.joint(int(model.dof_jntid[worst])).name[:60]
            why = f"joint {joint!r} has {word}={numbers[worst]:g}; it cannot be below 0"
            raise SessionError(why, file=name)


def _check_names(session: Session, device: Device) -> None:
    """Refuse names that the model does not have, all at once.

    Raises:
        SessionError: says where each stands.
    """
    of_effects = [entry.joint for entry in session.declared]
    # By default limbs are where effects are declared: whoever wrote a name is told of it there.
    limbs = [name for name in session.limb_joints if name not in of_effects]
    said = [
        *_unknown("ignored_joints", session.ignored_joints, device.joints),
        *(
            fault
            for number, name in enumerate(of_effects)
            for fault in _unknown(
                f"declared_effects[{number}].joint", [name], device.recorded_joints
            )
        ),
        *_unknown("limb_joints", limbs, device.joints),
    ]
    for number, trial in enumerate(session.trials):
        for where, load in (("added_mass", trial.added_mass), ("payload", trial.payload)):
            if load is not None:
                said += _unknown(f"trials[{number}].{where}.body", [load.body], device.bodies)
    if said:
        raise SessionError("; ".join(said), file=SESSION_FILE)


def _unknown(where: str, given: Sequence[str], names: tuple[str, ...]) -> list[str]:
    """Say which names that stand somewhere a model does not have."""
    wrong = [repr(name[:60]) for name in given if name not in names]
    verb = "is" if len(wrong) == 1 else "are"
    said = f"{where} {', '.join(wrong[:20])} {verb} unknown; the model has {listed(names)}"
    return [said] if wrong else []


def _read_model(path: Path, name: str) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Return the model of a file, and what of it is taken otherwise."""
    remarks: tuple[str, ...] = ()
    text = read_text(path, name, MAX_MODEL_BYTES)
    try:
        root = parse_model(text, lambda detail: SessionError(detail, file=name))
    except XmlError as error:
        raise SessionError(f"is not XML: {error}", file=name, line=error.line) from None
    if root.tag == "robot":
        remarks = urdf.prepare(root, name)
    else:
        _leave_out_drawing(root, name)
    _check_masses(root, name)
    for element in root.iter():
        if element.tag in REFUSED_ELEMENTS:
            why = (
                f"<{element.tag}> is {REFUSED_ELEMENTS[element.tag]}; "
                "a session's model is one open chain in one file"
            )
            raise SessionError(why, file=name)
        if any(key.startswith("file") for key in element.attrib):
            raise SessionError(
                f"<{element.tag}> needs an external file; draw with primitive geoms", file=name
            )
    for custom in root.iter("text"):
        # MuJoCo reads it as character data alone, which ElementTree does not keep apart.
        if custom.text and "data" not in custom.attrib:
            custom.set("data", custom.text)
            custom.text = None
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise _refused(error, name) from None
    _name_bodies(spec)
    for joint in spec.joints:
        # From nowhere to nowhere is no range, which MuJoCo writes as one from 0 to 0.
        if np.isinf(joint.range).all():
            joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_FALSE, [0.0, 0.0]
    return spec, remarks


def _name_bodies(spec: mujoco.MjSpec) -> None:
    """Give every body that has no name one after its joint: reports say what hangs where."""
    taken = {body.name for body in spec.bodies}
    for number, body in enumerate(spec.bodies):
        if not body.name:
            name = f"{body.joints[0].name}_link" if body.joints else f"body_{number}"
            body.name = f"body_{number}" if name in taken else name
            taken.add(body.name)


def _leave_out_drawing(root: ElementTree.Element, name: str) -> None:
    """Remove what draws an MJCF model from files; refuse a moving body without another inertia.

    Raises:
        SessionError: MuJoCo would have taken the body's inertia from a mesh.
    """
    for parent in [*root.iter()]:
        parent.attrib.pop("material", None)
        for child in [*parent]:
            if child.tag in DRAWN or (child.tag == "geom" and _is_mesh(child)):
                parent.remove(child)
                if child.tag == "geom" and parent.tag == "body" and not _has_inertia(parent):
                    why = (
                        f"body {parent.get('name')!r} takes its inertia from a mesh, which is not "
                        "read; give it an <inertial>"
                    )
                    raise SessionError(why, file=name)


def _check_masses(root: ElementTree.Element, name: str) -> None:
    """Refuse a negative mass, which MuJoCo takes for none in a body without a joint of its own.

    Raises:
        SessionError: names the body that holds it.
    """
    for parent in root.iter():
        for child in parent:
            said = {key: child.get(key) for key in NEVER_NEGATIVE}
            if child.tag == "mass":
                said["mass"] = child.get("value")
            for key, text in said.items():
                if text is not None and any(_is_negative(word) for word in text.split()):
                    owner = f"{parent.tag} {parent.get('name', '')[:60]!r}"
                    why = f"<{child.tag}> of {owner} has {key}={text[:40]!r}; none is below 0"
                    raise SessionError(why, file=name)


def _is_negative(word: str) -> bool:
    try:
        return float(word) < 0.0
    except ValueError:
        return False


def _is_mesh(geom: ElementTree.Element) -> bool:
    return geom.get("type") in ("mesh", "hfield", "sdf") or geom.get("mesh") is not None


def _has_inertia(body: ElementTree.Element) -> bool:
    """Whether a body states its inertia, or hangs on nothing that moves and needs none."""
    return body.find("inertial") is not None or body.find("joint") is None


def _refused(error: ValueError, name: str) -> SessionError:
    # Its lines are those of the text that MuJoCo was given, and not the file's.
    why = re.sub(r",? line \d+(, column \d+)?", "", " ".join(str(error).split()))
    return SessionError(f"MuJoCo refuses it: {why}", file=name)
