"""TOML files that anybody may have written: read within limits, each fault one line."""

from __future__ import annotations

import re
import tomllib
from typing import IO, Any, Literal, Protocol

from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.errors import DataError

__all__ = ["parse_toml", "read_limited"]


class _Readable(Protocol):
    """A path, wherever it leads."""

    def open(self, mode: Literal["rb"]) -> IO[bytes]:
        """Open the file for reading its bytes."""


def read_limited(path: _Readable, name: str) -> str:
    """Return the text of a small UTF-8 file; ``name`` is what messages call it.

    Raises DataError where it is larger than the limit ``toml_bytes`` or no UTF-8, OSError where it can't be read.
    """
    largest = limit("toml_bytes")
    with path.open("rb") as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise DataError(f"{name}: larger than {largest} bytes; {refusal_hint('toml_bytes')}")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: byte 0x{content[error.start]:02x} is not UTF-8; save it as UTF-8") from error


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Return the tables of TOML text; raises DataError for what is none or is nested beyond reason."""
    if len(text) > limit("toml_bytes"):
        raise DataError(f"{name}: larger than {limit('toml_bytes')} bytes; {refusal_hint('toml_bytes')}")
    most = limit("toml_key_parts")
    chain = re.search(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{most}}}", text)
    if chain is not None:
        line = text.count("\n", 0, chain.start()) + 1
        raise DataError(f"{name}: line {line}: a key of more than {most} parts; {refusal_hint('toml_key_parts')}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{name}: not TOML: {error}") from error
    except RecursionError:
        raise DataError(f"{name}: not TOML that can be read: brackets are nested too deeply") from None
    except ValueError as error:  # an integer of thousands of digits, a date that there is not
        raise DataError(f"{name}: not TOML that can be read: {str(error).partition(';')[0]}") from error
