"""Which importer a file belongs to: by lines that only one program writes, or by the names of its arrays."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import PurePath
from typing import IO

from nlosctl import registry
from nlosctl.contract.formats import ImporterSpec
from nlosctl.errors import DataError, NlosctlError
from nlosctl.io.conversion.import_source import array_names
from nlosctl.io.paths.locations import location

__all__ = ["AUTO", "Makers", "choose_importer", "import_hint", "makers_of", "makers_of_folder"]

AUTO = "auto"
"""The name that stands for the importer that recognizes the file."""

_HEAD_LINES = 20
_LINE_BYTES = 400
_LONGEST_LINE = 1 << 20
_BOUNDS = re.compile(rb"(?<=</DATA>)|(?=<DATA>)|(?<=\})|(?=\{)")
"""Where a record may end within a line, and one of another program begin."""


@dataclass(frozen=True, kw_only=True)
class Makers:
    """The importers to which lines of a file belong, in the order of their first ``lines`` (from 1, 0 for arrays).

    ``first`` is the first line that is not blank.
    """

    lines: dict[str, int]
    first: int = 0


def makers_of(stream: IO[bytes], wanted: str = AUTO, *, head: bool = False) -> Makers:
    """Return the importers that recognize lines of a file (its first ones for ``head``) or its arrays.

    A line that the ``wanted`` importer recognizes is its own, whatever others match. The position in the stream is the
    beginning, before and after.
    """
    specs = _specs()
    names = array_names(stream)
    stream.seek(0)
    if names is not None:
        fitting = [spec for spec in specs if any(set(wanted) <= set(names) for wanted in spec.arrays)]
        return Makers(lines=dict.fromkeys((spec.name for spec in fitting), 0))
    specs.sort(key=lambda spec: spec.name != wanted)
    patterns = [(spec.name, re.compile(spec.begins_like)) for spec in specs if spec.begins_like]
    lines: dict[str, int] = {}
    first = 0
    for number, text in _beginnings(stream, _HEAD_LINES if head else None):
        first = first or number
        name = next((name for name, pattern in patterns if pattern.match(text)), None)
        if name is not None:
            lines.setdefault(name, number)
    stream.seek(0)
    return Makers(lines=lines, first=first)


def makers_of_folder(names: Sequence[str], streams: Sequence[IO[bytes]]) -> Makers:
    """Return the importers that recognize the files of a folder, or their names as those of arrays."""
    stems = [PurePath(name).stem for name in names]
    lines = {
        spec.name: 0
        for spec in _specs()
        if spec.several
        and any(
            all(any(f"{stem}_".startswith(f"{name}_") for stem in stems) for name in wanted) for wanted in spec.arrays
        )
    }
    for stream in () if lines else streams:
        lines.update(makers_of(stream).lines)
    return Makers(lines=lines, first=-1)


def _beginnings(stream: IO[bytes], count: int | None) -> Iterator[tuple[int, str]]:
    """Yield line number and beginning of each record: of a line, and of what follows the end of a record in it."""
    for number, line in enumerate(islice(iter(lambda: stream.readline(_LONGEST_LINE), b""), count), 1):
        has_bounds = b"{" in line or b"}" in line or b"DATA>" in line
        for piece in _BOUNDS.split(line) if has_bounds else [line]:
            text = piece[:_LINE_BYTES].decode("utf-8", "replace").removeprefix("\ufeff").strip()
            if text:
                yield number, text


def _specs() -> list[ImporterSpec]:
    """Return the importers that can be loaded."""
    found = []
    for entry in registry.format_entries():
        if entry.kind == "import":
            with suppress(NlosctlError):
                spec = registry.load_format(entry)
                if isinstance(spec, ImporterSpec):
                    found.append(spec)
    return found


def choose_importer(wanted: str, makers: Makers, file: str) -> str:
    """Return the importer of a file: ``wanted``, or for `AUTO` the one that recognizes it.

    Raises DataError if none does, or if lines belong to several, or to another than the wanted one. A first line that
    looks like another's is accepted: columns of a table may have any names.
    """
    found = dict(makers.lines)
    if wanted != AUTO:
        others = [name for name in found if name != wanted and (wanted in found or found[name] > makers.first)]
        if len(others) == 1 and wanted not in found:
            raise DataError(f"{file}: is not a file for the importer {wanted!r}{_hint(others[0], found[others[0]])}")
        if not others:
            return wanted
    if len(found) > 1:
        places = " and ".join(f"{name!r} (line {line})" for name, line in found.items())
        raise DataError(f"{file}: has lines for the importers {places}; convert the lines of each separately")
    if not found:
        names = ", ".join(spec.name for spec in _specs())
        raise DataError(f"{file}: no importer recognizes it; name one with `from`: {names}")
    return next(iter(found))


def _hint(name: str, line: int = 0) -> str:
    where = f" (line {line})" if line > 1 else ""
    return f"; it looks like a file for the importer {name!r}{where}: convert it by `from` {name}"


def import_hint(names: Sequence[str], tried: str | None = None) -> str:
    """Return which importer the first file of ``names`` looks like, for a message, or an empty text.

    Only importers that can be loaded are considered, and not the one that was tried.
    """
    try:
        path = location(names[0])
        with path.open("rb") as file:
            makers = makers_of(file, head=True)
    except (NlosctlError, OSError, IndexError, ValueError):
        return ""
    name = next((name for name in makers.lines if name != tried), None)
    return "" if name is None else _hint(name)
