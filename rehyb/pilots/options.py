"""What kind of value an option of a provider takes, by the provider's signature."""

from inspect import Parameter
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

#: Of kinds: what a value of TOML may be, and how that is called.
_KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    str: ((str,), "a text in quotes"),
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    list: ((list,), "a list of texts, as ['a', 'b']"),
    dict: ((dict,), "a table of texts, as {a = 'b'}"),
}


def objection(parameter: Parameter, value: Any) -> str | None:
    """Say in a sentence that an option is of another kind than a provider takes; None if it is not.

    What the signature does not tell is left to the provider.
    """
    kinds = [_KINDS[kind] for kind in _wanted(parameter) if kind in _KINDS]
    if not kinds or any(_is(value, taken) for taken, _ in kinds):
        return None
    return f"{parameter.name} is {' or '.join(called for _, called in kinds)}, not {value!r}"


def _wanted(parameter: Parameter) -> list[Any]:
    """Return the kinds that a parameter takes; none: that is not known."""
    annotation = parameter.annotation
    if annotation is Parameter.empty:
        # Where nothing is said the default shows; of a number not whether it must be whole.
        kind = type(parameter.default)
        return [float if kind is int else kind]
    union = get_origin(annotation) in (Union, UnionType)
    members = [one for one in get_args(annotation) if one is not NoneType] if union else []
    return [get_origin(one) or one for one in members or [annotation]]


def _is(value: Any, taken: tuple[type, ...]) -> bool:
    # To Python true is a number.
    return isinstance(value, taken) and (bool in taken or not isinstance(value, bool))
