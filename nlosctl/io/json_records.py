"""Lines of JSON parsed to objects, each fault of a line told."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from nlosctl.io.raw import LineFault
from nlosctl.io.text_columns import shown

__all__ = ["JsonBlock", "json_text"]


class JsonBlock:
    """Lines that parsed as objects, with their line numbers, and those that did not."""

    def __init__(self, first_line: int, lines: Sequence[bytes]) -> None:
        self.objects: list[dict[str, Any]] = []
        self.numbers: list[int] = []
        self.faults: list[LineFault] = []
        for number, line in enumerate(lines, start=first_line):
            if line.strip():
                self._take(number, line)

    def _take(self, number: int, line: bytes) -> None:
        try:
            parsed = _DECODER.decode(line.decode("utf-8-sig" if number == 1 else "utf-8"))
            if b"\\u" in line and isinstance(parsed, dict):
                "".join(parsed).encode()
        except _TwiceError as error:
            self._refuse(number, line, f"the name {shown(error.args[0])} is there twice, expected it once")
        except UnicodeDecodeError as error:
            self._refuse(number, line, f"byte 0x{line[error.start]:02x} is not UTF-8; save the file as UTF-8")
        except UnicodeEncodeError:
            self._refuse(number, line, "a name holds half of a surrogate pair, expected Unicode text")
        except json.JSONDecodeError as error:
            self._refuse(number, line, f"not JSON at character {error.colno}: {error.msg}")
        except RecursionError:
            self._refuse(number, line, "brackets are nested too deeply, expected an object of plain values")
        except ValueError:
            self._refuse(number, line, "an integer has thousands of digits, expected a number within 1e308")
        else:
            if isinstance(parsed, dict):
                self.objects.append(parsed)
                self.numbers.append(number)
            else:
                self._refuse(number, line, f'got {shown(parsed)}, expected an object like {{"sensor": ...}}')

    def _refuse(self, number: int, line: bytes, fault: str) -> None:
        text = line.decode("utf-8", errors="backslashreplace").rstrip("\r\n")
        self.faults.append(LineFault(row=number, line=number, fault=fault, text=text))


def json_text(value: Any) -> str | None:
    """Return text as it is and other values as JSON; what UTF-8 can't hold is escaped."""
    if value is None:
        return None
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if text.isascii() else text.encode("utf-8", "backslashreplace").decode("utf-8")


class _TwiceError(ValueError):
    pass


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise _TwiceError(next(name for name in names if names.count(name) > 1))
    return found


_DECODER = json.JSONDecoder(object_pairs_hook=_object)
