"""The names of the part files in an output folder, from those of the input's parts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat, known_extension

__all__ = ["part_names"]


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
