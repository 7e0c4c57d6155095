"""A folder that a run fills part by part: what is done survives any interruption, the manifest comes last."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

from nlosctl.errors import DataError, in_one_line
from nlosctl.io.parts.manifest import make_manifest, plan_of_manifest, record_of, records_of_manifest, sealed_record
from nlosctl.io.paths.locations import Location, is_local, location
from nlosctl.io.writers.byte_output import write_text, writing

__all__ = ["MANIFEST", "RunFolder", "describe_file"]

MANIFEST = "_manifest.json"
_STATE = "_unfinished"
_PLAN = "plan.json"
_STORE_CLOCK_NS = 1_000_000_000
"""The times that stores tell are cut to the second; some tell none (0)."""


def describe_file(root: str, name: str, rows: int) -> dict[str, Any]:
    """Return name, rows, bytes and SHA-256 of a part file of the folder ``root``."""
    path = location(root) / name
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"name": name, "rows": rows, "bytes": path.stat().st_size, "sha256": digest}


class RunFolder:
    """The folders of one run: table name -> folder, the first of which also keeps what has been done so far.

    While the run is unfinished ``_unfinished/`` holds its plan and a record of each part that is done; at the end
    ``_manifest.json`` is written into each folder and ``_unfinished/`` goes.
    """

    def __init__(self, roots: Mapping[str, str]) -> None:
        self.roots = {table: str(location(root)) for table, root in roots.items()}
        self.main = location(next(iter(self.roots.values())))
        self._state = self.main / _STATE

    def open(
        self, plan: Mapping[str, Any], modified: Mapping[str, int], *, resume: bool, overwrite: bool
    ) -> dict[int, dict[str, Any]]:
        """Make the folders ready and return the records of the parts that are done, by number.

        ``plan`` is all that the results depend on, as plain values, its ``parts`` their names; ``modified`` tells when
        each input was changed (ns). Raises DataError where a folder holds something else, or (with ``resume``) was
        begun with another plan or on other inputs.
        """
        for root in self.roots.values():
            with writing(root):
                _check_root(location(root))
        try:
            with writing(str(self.main)):
                return self._opened(plan, modified, resume=resume, overwrite=overwrite)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.main}: its {MANIFEST} or {_STATE}/{_PLAN} is not what a run writes ({in_one_line(error)}); "
                f"name another folder"
            ) from error

    def _opened(
        self, plan: Mapping[str, Any], modified: Mapping[str, int], *, resume: bool, overwrite: bool
    ) -> dict[int, dict[str, Any]]:
        begun = self._plan_begun()
        if begun is not None and resume:
            return self._resumed(begun, json.loads(json.dumps(plan)), dict(modified))
        if begun is not None and not overwrite:
            raise DataError(self._is_there())
        if begun is not None:
            self._clear()
        for root in self.roots.values():
            _refuse_strangers(location(root))
        self._begin(plan, modified)
        return {}

    def keep(self, number: int, record: Mapping[str, Any]) -> None:
        """Remember that a part is done, where a plan was begun."""
        if self._state.is_dir():
            write_text(str(self._record_path(number)), json.dumps(sealed_record(record)))

    def finish(
        self, plan: Mapping[str, Any], records: Mapping[int, Mapping[str, Any]], report: Mapping[str, Any]
    ) -> None:
        """Write the manifest of each table's folder, that of the first last; the run is finished then."""
        parts = [records[number] for number in sorted(records)]
        with writing(str(self.main)):
            self.remove_temporary_files(plan.get("parts", []))
            for table, root in reversed(self.roots.items()):
                manifest = make_manifest(table, plan, parts, report, is_main=location(root) == self.main)
                text = json.dumps(manifest, indent=2, ensure_ascii=False)
                write_text(str(location(root) / MANIFEST), text + "\n")
            self._forget_state()

    def _begin(self, plan: Mapping[str, Any], modified: Mapping[str, int]) -> None:
        for root in self.roots.values():
            location(root).mkdir(exist_ok=True)
        self._state.mkdir(exist_ok=True)
        write_text(str(self._state / _PLAN), json.dumps({"plan": plan, "modified": dict(modified)}))

    def _plan_begun(self) -> dict[str, Any] | None:
        """Return the plan of the run that is in the folder, finished or not, or None where there is none."""
        told = _read_json(self._state / _PLAN)
        if told is not None:
            return dict(told["plan"])
        manifest = self._manifest()
        return None if manifest is None else plan_of_manifest(manifest)

    def _manifest(self) -> dict[str, Any] | None:
        manifest = _read_json(self.main / MANIFEST)
        return manifest if manifest is not None and {"parts", "inputs", "table"} <= manifest.keys() else None

    def _resumed(
        self, begun: dict[str, Any], plan: dict[str, Any], modified: dict[str, int]
    ) -> dict[int, dict[str, Any]]:
        difference = _difference(begun, plan) or self._changed_input(modified)
        if difference is not None:
            raise DataError(
                f"{self.main}: --resume: {difference}; run it with the same words on the same inputs, or begin anew "
                f"with --overwrite"
            )
        records = {number: record for number, record in self._records().items() if self._is_whole(record)}
        if not (self.main / MANIFEST).exists() or len(records) < len(plan["parts"]):
            self._begin(plan, modified)
            for number, record in records.items():
                self.keep(number, record)
            for root in self.roots.values():
                (location(root) / MANIFEST).unlink(missing_ok=True)
            self.remove_temporary_files(plan.get("parts", []))
        return records

    def _changed_input(self, modified: Mapping[str, int]) -> str | None:
        """Return in words which input has been written to since the run was begun, or since it was finished."""
        told = _read_json(self._state / _PLAN)
        if told is not None:
            changed = [name for name, when in modified.items() if told.get("modified", {}).get(name) != when]
        else:
            finished = (self.main / MANIFEST).stat().st_mtime_ns
            slack = _STORE_CLOCK_NS if not is_local(self.main) else 0
            changed = [name for name, when in modified.items() if finished and when > finished + slack]
        return f"the input {changed[0]} has changed since" if changed else None

    def _records(self) -> dict[int, dict[str, Any]]:
        manifest = self._manifest()
        records = {} if manifest is None else records_of_manifest(manifest)
        if self._state.is_dir():
            for path in _entries(self._state):
                record = record_of(_read_json(path)) if path.name != _PLAN else None
                if record is not None and path.stem.isdigit():
                    records[int(path.stem)] = record
        return records

    def _is_whole(self, record: Mapping[str, Any]) -> bool:
        """Return whether all files of a part are there as they were written."""
        for table, root in self.roots.items():
            told = record["files"].get(table)
            if told is None or not _inside(location(root), told["name"]):
                return False
            path = location(root) / told["name"]
            if not path.is_file() or describe_file(root, told["name"], told["rows"]) != told:
                return False
        return True

    def _clear(self) -> None:
        """Remove what the earlier run wrote, its manifest first; nothing else."""
        records = self._records()
        plan = self._plan_begun() or {}
        self.remove_temporary_files(plan.get("parts", []))
        for root in self.roots.values():
            (location(root) / MANIFEST).unlink(missing_ok=True)
        names = [told["name"] for record in records.values() for told in record["files"].values()]
        for root in self.roots.values():
            for name in [*names, *plan.get("parts", [])]:
                if _inside(location(root), name):
                    (location(root) / name).unlink(missing_ok=True)
                    _remove_empty_folders(location(root), name)
        self._forget_state()

    def remove_temporary_files(self, parts: Sequence[str]) -> None:
        """Remove what a process that was stopped has left of the files of these parts that it was writing."""
        for root in map(location, self.roots.values()):
            paths = [root / name for name in parts if _inside(root, name)]
            begins = {f".{path.name[:100]}." for path in paths}
            for folder in dict.fromkeys(path.parent for path in paths):
                for left in _entries(folder):
                    if left.name.endswith(".part") and left.name.startswith(tuple(begins)):
                        left.unlink(missing_ok=True)
        for left in _entries(self._state):
            if left.name.startswith(".") and left.name.endswith(".part"):
                left.unlink(missing_ok=True)

    def _forget_state(self) -> None:
        if self._state.is_dir():
            for path in sorted(_entries(self._state), key=lambda path: path.name == _PLAN):
                path.unlink(missing_ok=True)
            self._state.rmdir()

    def _record_path(self, number: int) -> Location:
        return self._state / f"{number:06d}.json"

    def _is_there(self) -> str:
        if (self.main / MANIFEST).exists():
            return f"{self.main}: holds results already; --overwrite replaces them"
        return f"{self.main}: holds an unfinished run; --resume goes on with it, --overwrite begins anew"


def _check_root(root: Location) -> None:
    if root.exists() and not root.is_dir():
        raise DataError(f"{root}: is a file, expected a folder")
    if not is_local(root):
        if not root.has_bucket():
            raise DataError(f"{root}: there is no {str(root.top)!r}; make it first")
    elif not root.exists() and not root.parent.is_dir():
        raise DataError(f"{root}: there is no folder {str(root.parent)!r}; make it first")


def _entries(folder: Location) -> list[Location]:
    """Return what is in a folder, nothing where there is none."""
    if not is_local(folder):
        return [*folder.iterdir()]
    return [*folder.iterdir()] if folder.is_dir() else []


def _refuse_strangers(root: Location) -> None:
    if root.is_dir():
        found = sorted(path.name for path in root.iterdir() if path.name != _STATE)
        if found:
            raise DataError(f"{root}: the folder holds other files already ({found[0]!r}); name an empty or a new one")


def _read_json(path: Location) -> dict[str, Any] | None:
    """Return a JSON object, or None where there is none that is whole."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _inside(root: Location, name: str) -> bool:
    """Return whether a name leads to a place within the folder, symbolic links followed."""
    steps = PurePosixPath(name)
    if steps.is_absolute() or ".." in steps.parts or not steps.parts:
        return False
    return not is_local(root) or (root / name).parent.resolve().is_relative_to(root.resolve())


def _remove_empty_folders(root: Location, name: str) -> None:
    for folder in list(PurePosixPath(name).parents)[:-1]:
        with suppress(OSError):
            (root / str(folder)).rmdir()


def _difference(begun: Any, now: Any, where: str = "") -> str | None:
    """Return in words the first difference of two plans, or None."""
    if isinstance(begun, dict) and isinstance(now, dict):
        for key in [*begun, *(key for key in now if key not in begun)]:
            found = _difference(begun.get(key), now.get(key), f"{where}.{key}" if where else key)
            if found is not None:
                return found
        return None
    if isinstance(begun, list) and isinstance(now, list) and len(begun) == len(now):
        for place, (earlier, later) in enumerate(zip(begun, now, strict=True)):
            name = later.get("name", place) if isinstance(later, dict) else place
            found = _difference(earlier, later, f"{where}[{name}]")
            if found is not None:
                return found
        return None
    return None if begun == now else f"{where} was {_short(begun)} and is {_short(now)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else f"{text[:77]}..."
