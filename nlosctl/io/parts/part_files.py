"""The parts of an output folder: slices of long Parquet files, and the names of part files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat, known_extension
from nlosctl.io.readers.parquet_arrow import parquet_metadata

__all__ = ["part_names", "sliced"]


def sliced(inputs: Sequence[Input], rows: int) -> tuple[Input, ...]:
    """Return the inputs with every Parquet file cut into parts of at least ``rows`` rows, between row groups.

    Other files are not cut.
    """
    return tuple(
        replace(given, parts=tuple(piece for part in given.parts for piece in _slices(part, rows))) for given in inputs
    )


def _slices(part: Part, rows: int) -> Iterator[Part]:
    if part.format is not FileFormat.PARQUET or part.path is None or part.row_groups is not None:
        yield part
        return
    metadata = parquet_metadata(part.path)
    start, count = 0, 0
    for index in range(metadata.num_row_groups):
        count += metadata.row_group(index).num_rows
        if count >= rows or index == metadata.num_row_groups - 1:
            yield replace(part, row_groups=(start, index + 1))
            start, count = index + 1, 0
    if not metadata.num_row_groups:
        yield part


def part_names(inputs: Sequence[Input], format: FileFormat) -> list[str]:
    """Return a relative path for each part of ``inputs``, all different and within the folder.

    ``year=2026/a.csv`` of a folder becomes ``year=2026/a.parquet``, or keeps the input's extension too if another part
    has that name. Names that begin with ``.`` or ``_``, which readers of folders ignore, get the prefix ``part``.
    """
    paths = [_relative(given, part) for given in inputs for part in given.parts]
    stems = [path.removesuffix(known_extension(path)) for path in paths]
    names: list[str] = []
    taken: set[str] = set()
    for path, stem in zip(paths, stems, strict=True):
        base = stem if stems.count(stem) == 1 else path
        name, number = f"{base}.{format.value}", 2
        while name.casefold() in taken:
            name, number = f"{base}-{number}.{format.value}", number + 1
        taken.add(name.casefold())
        names.append(name)
    return names


def _relative(given: Input, part: Part) -> str:
    path, root = PurePosixPath(part.name), PurePosixPath(given.name)
    steps = path.relative_to(root).parts if path != root and path.is_relative_to(root) else (path.name,)
    safe = [f"part{step}" if step.startswith((".", "_")) else step for step in steps if step != "/"]
    return "/".join(safe)
