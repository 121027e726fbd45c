"""What was learnt as arrays by name: a part's names begin with its own, as its parts' do."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def arrays_of(learnt: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of a dataclass of arrays and such dataclasses, with their names."""
    for field in fields(learnt):
        value, own = getattr(learnt, field.name), f"{name}.{field.name}"
        if is_dataclass(value):
            yield from arrays_of(value, own)
        else:
            yield own, value


def built(kind: type[T], arrays: Mapping[str, np.ndarray], name: str) -> T:
    """Return what `arrays_of` took apart.

    Raises:
        KeyError: the name of an array that is missing.
    """
    own: dict[str, Any] = {}
    for field in fields(kind):  # type: ignore[arg-type]
        part = f"{name}.{field.name}"
        if isinstance(field.type, type) and is_dataclass(field.type):
            own[field.name] = built(field.type, arrays, part)
        else:
            own[field.name] = arrays[part]
    return kind(**own)
