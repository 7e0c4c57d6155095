"""Decoding the tables of a TOML file into typed structs, each fault told by its key."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.errors import DataError, did_you_mean

__all__ = ["Decoder", "Finite", "Point"]

StructT = TypeVar("StructT", bound=msgspec.Struct)

Finite = float
"""A number; the decoder refuses NaN, infinity and what is larger than `LARGEST_NUMBER` everywhere."""

Point = tuple[Finite, Finite]
"""x and y in metres."""

_EXPECTED = {
    "float": "a number",
    "str": "text",
    "tuple[float, float]": "two numbers, [x, y]",
    "float | None": "a number",
    "tuple[float, float] | None": "two numbers, [x, y]",
}


@dataclass(frozen=True, kw_only=True)
class Decoder:
    """Decodes entries of one file; ``file`` is its name, for messages."""

    file: str

    def decode(self, entry: Mapping[str, Any], struct: type[StructT], where: str) -> StructT:
        """Return ``entry`` as ``struct``; ``where`` is its place, such as ``reflector[1]``. Raises DataError."""
        keys = {field.encode_name: field for field in msgspec.structs.fields(struct)}
        for key, value in entry.items():
            if key not in keys:
                known = ", ".join(keys)
                self.refuse(f"{where}.{key}", f"unknown key{did_you_mean(key, keys)}; there are: {known}")
            self._check(f"{where}.{key}", value, keys[key].type)
        for key, field in keys.items():
            if field.required and key not in entry:
                self.refuse(f"{where}.{key}", f"missing, expected {_expected(field.type)}")
        return msgspec.convert(dict(entry), struct)

    def _check(self, where: str, value: Any, wanted: Any) -> None:
        try:
            converted = msgspec.convert(value, wanted)
        except msgspec.ValidationError:
            self.refuse(where, f"got {value!r}, expected {_expected(wanted)}")
        numbers = converted if isinstance(converted, tuple) else (converted,)
        if any(isinstance(number, float) and not abs(number) <= LARGEST_NUMBER for number in numbers):
            self.refuse(where, f"got {value!r}, expected finite numbers within {LARGEST_NUMBER:g}")

    def refuse(self, where: str, fault: str) -> None:
        """Raise DataError for the key ``where``."""
        raise DataError(f"{self.file}: {where}: {fault}")


def _expected(wanted: Any) -> str:
    name = wanted.__name__ if isinstance(wanted, type) and not hasattr(wanted, "__args__") else str(wanted)
    name = re.sub(r"typing\.|NoneType", lambda found: "None" if found[0] == "NoneType" else "", name)
    literal = re.fullmatch(r"Literal\[(.*)\]", name)
    return literal[1] if literal else _EXPECTED.get(name, name)
