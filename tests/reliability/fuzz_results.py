"""Whether the results from a corrupted file that was accepted agree with the content of the file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import pyarrow as pa
from guarded_run import Ending, complaints, run_guarded
from independent_readers import differences, read_independently
from other_seeds import expected_folder
from seed_files import SeedFile

__all__ = ["Case", "result_complaints"]


@dataclass(frozen=True, kw_only=True)
class Case:
    """An input: its number, the seed file, its bytes, and the arguments of the run."""

    number: int
    seed_file: SeedFile
    content: bytes
    words: tuple[str, ...]
    outputs: tuple[str, ...]


_JOBS = ("localize", "detect-ip", "identify-los", "bound")


def result_complaints(case: Case, ending: Ending, folder: Path) -> Iterator[str]:
    """Yield complaints about the results of a case that succeeded."""
    target, words = case.seed_file.target, case.words
    if ending.code != 0:
        return
    if target in ("manifest", "cache"):
        yield from _folder_complaints(target, folder)
    elif "--from" in words:
        yield from _accepted(folder, case.outputs, ["o.arrow"], earth=case.seed_file.kind.startswith("kraken"))
    elif target in ("parquet", "arrow", "csv", "jsonl"):
        if "f.arrow" in case.outputs:
            yield from _compared(case, folder)
        if case.number % 5 == 0 and "bad.arrow" not in case.outputs and words[0] in _JOBS:
            scene = words[words.index("--scene") : words.index("--scene") + 2] if "--scene" in words else ()
            yield from _accepted(folder, case.outputs, [case.seed_file.name, *scene])
    else:
        for name in case.outputs:
            yield from _form_complaints(folder / name)


def _accepted(folder: Path, outputs: tuple[str, ...], words: list[str], *, earth: bool = False) -> Iterator[str]:
    """Yield a complaint if ``validate`` refuses what another command accepted or wrote."""
    if earth and not find_spec("pyproj"):
        return
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded(["validate", *words, "-q", *(("--origin", "47.4,8.5") if earth else ())])
    yield from complaints(ending, folder, (), before)
    if ending.code != 0 and not re.search(r"scene (has no|with its) sensor", ending.err):  # undecided
        yield f"accepted, but validate reports: {ending.err[:300]!r}"


def _compared(case: Case, folder: Path) -> Iterator[str]:
    """Yield differences of the flags, or the copy, from the content that an independent reader returns."""
    try:
        rows = read_independently(case.seed_file.name, case.content)
    except Exception as error:  # a file that the program reads must be readable by others, unless rows were set aside
        if "bad.arrow" not in case.outputs:
            yield f"accepted, but not readable elsewhere: {type(error).__name__}: {error}"
        return
    with pa.memory_map(str(folder / "f.arrow")) as file:
        flags = pa.ipc.open_file(file).read_all()
    if "bad.arrow" in case.outputs:
        with pa.memory_map(str(folder / "bad.arrow")) as file:
            aside = pa.ipc.open_file(file).read_all()
        kept = set(range(1, len(rows) + 1)) - set(aside.column("row").to_pylist())
        rows = [row for number, row in enumerate(rows, start=1) if number in kept]
    names = {name for row in rows for name in row} - {"los", "ip", "used"}
    yield from differences(rows, flags, names)


def _folder_complaints(target: str, folder: Path) -> Iterator[str]:
    """Yield the files in ``out`` that differ from those of a run into an empty folder."""
    whole = expected_folder(target)
    found = {path.relative_to(folder).as_posix(): path for path in (folder / "out").rglob("*") if path.is_file()}
    if found.keys() != whole.keys():
        yield f"files {sorted(found)}, expected {sorted(whole)}"
    for name in found.keys() & whole.keys():
        if name.endswith(".samples.parquet"):  # kept if its columns match its digest
            continue
        if found[name].read_bytes() != whole[name]:
            yield f"{name} differs from that of a run without the corrupted file"


def _form_complaints(path: Path) -> Iterator[str]:
    """Yield why a map does not have its format."""
    try:
        if path.suffix in (".geojson", ".czml"):
            json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        elif path.suffix in (".kml", ".svg"):
            ElementTree.parse(path)  # noqa: S314 - what we have written ourselves
    except (ValueError, ElementTree.ParseError) as error:
        yield f"{path.name} can't be read: {error}"


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON")
