"""The file of an `mjcf` model: read under limits; what reaches out of its folder is refused."""

import struct
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import mujoco

from intake.xml import XmlError, parse_model
from models.folder import ModelError

MAX_XML_BYTES = 5_000_000
#: Of one texture or height field: 4000 x 4000 and more.
MAX_PIXELS = 17_000_000
#: How to have one file of many, with every element written out.
_WHOLE = "write one file, as mujoco.MjSpec.from_file({file!r}).to_xml() returns it in Python"
#: Elements that reach outside the file, or that make elements without number.
REFUSED_ELEMENTS = {
    "include": f"an included file; {_WHOLE}",
    "plugin": "a plugin, which is code",
    "extension": "a plugin, which is code",
    "attach": f"an attached model; {_WHOLE}",
    "model": f"an attached model; {_WHOLE}",
    "replicate": f"a generator of elements; {_WHOLE}",
    "composite": f"a generator of elements; {_WHOLE}",
    "flexcomp": f"a generator of elements; {_WHOLE}",
}
#: What MuJoCo reads of a URDF.
_URDF = ("link", "joint", "material", "mujoco")
#: Attributes of <compiler> that say in which folder files are.
_FOLDERS = ("meshdir", "texturedir", "assetdir")


def read_spec(folder: Path, name: str, *, collisions: bool = True) -> mujoco.MjSpec:
    """Read the file `name` in a model's folder, with the meshes beside it.

    A URDF has no sensors and no motors: every joint that moves gets a motor of its name, and the
    sensors JOINT.position, JOINT.velocity and JOINT.torque (that arrives at the joint; SI units).
    What is drawn only may be missing, and what other programs keep in a URDF is left out.

    Args:
        folder: the model's.
        name: of the MJCF or URDF file.
        collisions: False leaves out the shapes of a URDF that touch.

    Raises:
        ModelError: it is not there, reaches out of the folder, or MuJoCo refuses it.
    """
    path = inside(folder, name, "mjcf.file")
    if path.stat().st_size > MAX_XML_BYTES:
        raise ModelError(f"is larger than {MAX_XML_BYTES // 1_000_000} MB", file=name)
    try:
        root = parse_model(
            path.read_text(encoding="utf-8-sig"), lambda detail: ModelError(detail, file=name)
        )
    except UnicodeDecodeError:
        raise ModelError("is not UTF-8 text", file=name) from None
    except XmlError as error:
        raise ModelError(f"line {error.line}: is not XML: {error}", file=name) from None
    if root.tag == "robot":
        _keep_dynamics(root, path, folder, collisions)
    elif not collisions:
        raise ModelError("mjcf.collisions is for a URDF; set contype and conaffinity in MJCF")
    for element in root.iter():
        if (what := REFUSED_ELEMENTS.get(element.tag)) is not None:
            raise ModelError(f"<{element.tag}> is {what.format(file=name)}", file=name)
    if root.tag == "robot":
        _keep_links(root)
    assets = _assets(root, path, folder, name)
    try:
        spec = mujoco.MjSpec.from_string(
            ElementTree.tostring(root, encoding="unicode"), assets=assets
        )
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"MuJoCo refuses it: {' '.join(str(error).split())}", file=name) from None
    if root.tag == "robot":
        _add_motors_and_sensors(spec)
    return spec


def inside(folder: Path, name: str, field: str) -> Path:
    """Return the path of a file of the model's folder.

    Raises:
        ModelError: there is no such file in it; `field` says what names it.
    """
    path = _in(folder, folder, name)
    if path is None:
        raise ModelError(f"{field} names {name[:80]!r}, which is not in the model's folder")
    return path


def _in(folder: Path, beside: Path, name: str) -> Path | None:
    """Return a file by its name beside others; None if there is none in `folder`."""
    try:
        path = (beside / name).resolve()
        return path if path.is_relative_to(folder.resolve()) and path.is_file() else None
    except (OSError, ValueError):
        return None


def _keep_dynamics(root: ElementTree.Element, path: Path, folder: Path, collisions: bool) -> None:
    """Leave out of a URDF what MuJoCo does not read, and drawn shapes whose files are missing."""
    for element in [*root]:
        if element.tag not in _URDF:
            root.remove(element)
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            drawn = shape.tag == "visual"
            files = [mesh.get("filename", "") for mesh in shape.iter("mesh")]
            gone = drawn and any(_there(folder, path.parent, [""], file) is None for file in files)
            if gone or not (drawn or collisions):
                link.remove(shape)


def _keep_links(root: ElementTree.Element) -> None:
    """Let every link stay a body, so that a factor finds it by its name."""
    settings = root.find("mujoco")
    if settings is None:
        settings = ElementTree.SubElement(root, "mujoco")
    compiler = settings.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(settings, "compiler")
    compiler.attrib.setdefault("fusestatic", "false")


def _add_motors_and_sensors(spec: mujoco.MjSpec) -> None:
    sensors = {
        "position": mujoco.mjtSensor.mjSENS_JOINTPOS,
        "velocity": mujoco.mjtSensor.mjSENS_JOINTVEL,
        "torque": mujoco.mjtSensor.mjSENS_JOINTACTFRC,
    }
    for joint in spec.joints:
        spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        for quantity, kind in sensors.items():
            name, joints = f"{joint.name}.{quantity}", mujoco.mjtObj.mjOBJ_JOINT
            spec.add_sensor(name=name, type=kind, objtype=joints, objname=joint.name)


def _assets(root: ElementTree.Element, path: Path, folder: Path, name: str) -> dict[str, bytes]:
    """Return the files that the XML names, and rename them in it so that no folder is named.

    MuJoCo then finds them among the assets, and looks nowhere else.
    """
    places = [""]
    for compiler in root.iter("compiler"):
        places += [compiler.attrib.pop(key) for key in _FOLDERS if key in compiler.attrib]
    renamed: dict[Path, str] = {}
    for element in root.iter():
        for key, file in [*element.attrib.items()]:
            if not key.startswith("file"):
                continue
            found = _find(folder, path.parent, places, file, name)
            _check_picture(found, file, name)
            renamed.setdefault(found, f"asset{len(renamed)}{found.suffix}")
            element.set(key, renamed[found])
            if key == "file" and root.tag == "mujoco":
                # MuJoCo would call it by its file's name.
                element.attrib.setdefault("name", PurePosixPath(file).stem)
    return {asset: found.read_bytes() for found, asset in renamed.items()}


def _check_picture(path: Path, file: str, name: str) -> None:
    """Refuse a PNG that unpacks to very much (PNG specification, section 11.2.2: IHDR)."""
    with path.open("rb") as picture:
        header = picture.read(24)
    if header[:8] != b"\x89PNG\r\n\x1a\n":
        return
    width, height = struct.unpack(">II", header[16:24]) if len(header) == 24 else (0, 0)
    if width * height > MAX_PIXELS:
        raise ModelError(
            f"names {file[:80]!r}, a picture of {width} x {height} pixels; at most "
            f"{MAX_PIXELS // 1_000_000} million",
            file=name,
        )


def _find(folder: Path, beside: Path, places: list[str], file: str, name: str) -> Path:
    """Return the file that an element names."""
    found = _there(folder, beside, places, file)
    if found is None:
        package = file.partition("://")[2].partition("/")[2]
        where = f", as {package[:80]!r} or in any folder that this ends with" if package else ""
        raise ModelError(
            f"names the file {file[:120]!r}, which is not in the model's folder{where}; without "
            "the shapes that touch, a URDF needs `collisions = false` under [mjcf]",
            file=name,
        )
    return found


def _there(folder: Path, beside: Path, places: list[str], file: str) -> Path | None:
    """Return a file of the folder; one in a package of ROS is found by the end of its path."""
    parts = PurePosixPath(file.split("://", 1)[-1]).parts
    tails = ["/".join(parts[i:]) for i in range(len(parts))] if "://" in file else [file]
    found = (_in(folder, beside / place, tail) for place in places for tail in tails)
    return next((path for path in found if path is not None), None)
