"""XML of a model, parsed under limits: no entities, no deep nesting, not too many bodies."""

import math
import re
from collections.abc import Iterable
from xml.etree import ElementTree

from intake.zips import Wrong

#: Deepest nesting of elements, and how many bodies: beyond, no arm and no robot is meant.
MAX_DEPTH, MAX_BODIES = 100, 200
#: Cells of a texture or a height field; numbers of anything; bytes of MuJoCo's own memory.
MAX_CELLS, MAX_SIZE, MAX_MEMORY = 17_000_000, 100_000, 2**30
#: What makes a grid, by element.
_GRIDS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_UNITS = [*"KMGTPE"]


class XmlError(ValueError):
    """The text is not XML; `line` says where."""

    def __init__(self, message: str, line: int) -> None:
        self.line = line
        super().__init__(message)


def parse_model(text: str, wrong: Wrong) -> ElementTree.Element:
    """Return the root of an MJCF (<mujoco>) or URDF (<robot>) file.

    Raises:
        XmlError: the text is not XML.
        Exception: what `wrong` makes of a sentence: it is no model, or one that would take
            MuJoCo very long or overflow its stack.
    """
    # Entities could unfold without end, and only a document type can define them.
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise wrong("may not define a document type or entities")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise XmlError(str(error), error.position[0]) from None
    if root.tag not in ("mujoco", "robot"):
        raise wrong(f"must be an MJCF (<mujoco>) or URDF (<robot>) file, not <{root.tag}>")
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise wrong(f"nests elements more than {MAX_DEPTH} deep")
        level = [child for element in level for child in element]
    _check_numbers(root, wrong)
    count = sum(1 for tag in ("body", "link") for _ in root.iter(tag))
    if count > MAX_BODIES:
        raise wrong(f"has {count} bodies; at most {MAX_BODIES}")
    return root


def listed(names: Iterable[str]) -> str:
    """Return the names that a file gives its elements, as far as a sentence has room for them."""
    given = [name[:60] for name in names if name]
    return ", ".join(given[:20]) or "none with a name"


def all_listed(names: Iterable[str]) -> str:
    """Return the same with how many there are more."""
    given = [*names]
    more = len([name for name in given if name]) - 20
    return listed(given) + (f" and {more} more" if more > 0 else "")


def _check_numbers(root: ElementTree.Element, wrong: Wrong) -> None:
    """Refuse what MuJoCo would compute with, or warn of on standard output."""
    names = {element.get("name") for element in root.iter()}
    for element in root.iter():
        for key, value in element.attrib.items():
            if value not in names and "nan" in value.lower().replace("-", " ").split():
                raise wrong(f"<{element.tag}> has {key}={value!r}; every number must be finite")
    for tag, sides in _GRIDS.items():
        for element in root.iter(tag):
            cells = math.prod(_size(element.get(side, "1")) for side in sides)
            if cells > MAX_CELLS:
                raise wrong(
                    f"<{tag}> has {cells:.3g} cells; at most {MAX_CELLS // 1_000_000} million"
                )
    for size in root.iter("size"):
        for key, value in size.attrib.items():
            if _size(value) > (MAX_MEMORY if key == "memory" else MAX_SIZE):
                raise wrong(f"<size> has {key}={value[:40]!r}, far more than a model takes")
    for option in root.iter("option"):
        step = option.get("timestep")
        if step is not None and not _is_step(step):
            raise wrong(f"<option> has timestep={step!r}; it must be a finite number above 0")


def _size(text: str) -> float:
    """Return a size, which may end in K, M, G, T, P or E; 0 if it is none: MuJoCo says so."""
    text = text.strip()
    letter = text[-1:].upper()
    try:
        if letter in _UNITS:
            return float(text[:-1]) * 1024.0 ** (1 + _UNITS.index(letter))
        return float(text)
    except ValueError:
        return 0.0


def _is_step(text: str) -> bool:
    try:
        return 0.0 < float(text) < math.inf
    except ValueError:
        # MuJoCo has its own words for it.
        return True
