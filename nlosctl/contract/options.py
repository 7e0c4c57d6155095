"""Typed options of methods and scenarios: declared as dataclass fields, parsed from text or Python values."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Any, TypeVar, get_type_hints

import msgspec

from nlosctl.errors import UsageError, did_you_mean

__all__ = ["describe_options", "option", "parse_options", "within_bounds"]

OptionsT = TypeVar("OptionsT")

_SHORT_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")

_LARGEST_INTEGER = 2**53
"""Up to this integer, every integer is also a float and fits in an array."""


def option(
    default: Any = dataclasses.MISSING,
    *,
    meaning: str,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    exclusive: bool = False,
) -> Any:
    """Declare a field of an options dataclass.

    ``minimum`` and ``maximum`` bound a number; with ``exclusive`` the bounds themselves are not allowed. Without
    ``default`` the option is required. The annotation of the field is its type: bool, int, float, str,
    ``Literal[...]``, a tuple of these, or any of them ``| None``.
    """
    metadata = {"meaning": meaning, "unit": unit, "minimum": minimum, "maximum": maximum, "exclusive": exclusive}
    return dataclasses.field(default=default, metadata=metadata)


def parse_options(options: type[OptionsT], given: Mapping[str, Any], owner: str) -> OptionsT:
    """Return ``options`` built from ``given``: text from a command line, or Python values.

    Raises UsageError for an unknown key, a value of the wrong type or outside its bounds, or a missing key.
    """
    fields = {field.name: field for field in dataclasses.fields(options)}  # type: ignore[arg-type]
    types = get_type_hints(options)
    values: dict[str, Any] = {}
    for key, value in given.items():
        if key not in fields:
            known = ", ".join(sorted(fields)) or "none"
            raise UsageError(f"{owner} has no parameter {key!r}{did_you_mean(key, fields)}; it has: {known}")
        values[key] = _convert(value, types[key], fields[key], owner)
    for name, field in fields.items():
        if name not in values and field.default is dataclasses.MISSING:
            raise UsageError(f"{owner} needs the parameter {name!r}: {field.metadata['meaning']}")
    return options(**values)


def within_bounds(options: type[Any], name: str, number: float) -> bool:
    """Return whether a number is within the bounds of an option."""
    return next(_within(number, field) for field in dataclasses.fields(options) if field.name == name)


def describe_options(options: type[Any]) -> list[dict[str, Any]]:
    """Return a list with name, type, unit, default, bounds and meaning of each option."""
    types = get_type_hints(options)
    return [
        {
            "name": field.name,
            "type": _type_name(types[field.name]),
            "unit": field.metadata["unit"],
            "required": field.default is dataclasses.MISSING,
            "default": None if field.default is dataclasses.MISSING else field.default,
            "bounds": _bounds(field),
            "meaning": field.metadata["meaning"],
        }
        for field in dataclasses.fields(options)
    ]


def _convert(value: Any, annotation: Any, field: dataclasses.Field[Any], owner: str) -> Any:
    wanted = _wanted(annotation, field)
    complaint = f"The {field.name!r} parameter of {owner} must be {wanted}. Got {value!r} instead."
    if isinstance(value, str) and value.lower() in ("none", "null") and _allows_none(annotation):
        return None
    if isinstance(value, str) and "tuple" in _type_name(annotation):
        value = [part.strip() for part in value.split(",")]
    if "float" in _type_name(annotation):
        value = [_full(part) for part in value] if isinstance(value, list) else _full(value)
    try:
        converted = msgspec.convert(value, annotation, strict=not isinstance(value, str | list))
    except msgspec.ValidationError:
        raise UsageError(complaint) from None
    numbers = converted if isinstance(converted, tuple) else (converted,)
    if not all(_within(number, field) for number in numbers):
        raise UsageError(complaint)
    return converted


def _full(value: Any) -> Any:
    """Return a number such as ``.1``, ``1.`` or ``+1`` in the digits that JSON requires; other values unchanged."""
    return repr(float(value)) if isinstance(value, str) and _SHORT_NUMBER.fullmatch(value.strip()) else value


def _within(number: Any, field: dataclasses.Field[Any]) -> bool:
    if isinstance(number, bool) or not isinstance(number, int | float):
        return True
    if isinstance(number, int) and abs(number) > _LARGEST_INTEGER:
        return False
    low, high = field.metadata["minimum"], field.metadata["maximum"]
    if field.metadata["exclusive"]:
        return bool(low < number < high)
    return bool(low <= number <= high) and not math.isinf(number)


def _wanted(annotation: Any, field: dataclasses.Field[Any]) -> str:
    name = _type_name(annotation)
    article = "an" if name[0] in "aeiou" else "a"
    bounds = _bounds(field)
    is_choice = "|" in name and ("'" in name or name[0].isdigit())
    choices = f"one of {name}" if is_choice else f"{article} {name}"
    return f"{choices} in the range {bounds}" if bounds else choices


def _bounds(field: dataclasses.Field[Any]) -> str:
    low, high = field.metadata["minimum"], field.metadata["maximum"]
    if math.isinf(low) and math.isinf(high):
        return ""
    left = "(" if field.metadata["exclusive"] or math.isinf(low) else "["
    right = ")" if field.metadata["exclusive"] or math.isinf(high) else "]"
    return f"{left}{low:g}, {high:g}{right}"


def _type_name(annotation: Any) -> str:
    if isinstance(annotation, type) and annotation is not type(None) and not hasattr(annotation, "__args__"):
        return annotation.__name__
    text = str(annotation).replace("typing.", "").replace("NoneType", "None")
    if text.startswith("Literal["):
        return " | ".join(repr(choice) for choice in annotation.__args__)
    return text


def _allows_none(annotation: Any) -> bool:
    return type(None) in getattr(annotation, "__args__", ())
