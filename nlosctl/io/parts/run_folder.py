"""The output folder of a run, written part by part: complete parts survive an interruption, the manifest is last."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import PurePosixPath
from typing import Any

from nlosctl.errors import DataError, in_one_line
from nlosctl.io.parts.manifest import (
    make_manifest,
    plan_difference,
    plan_of_manifest,
    record_of,
    records_of_manifest,
    sealed_record,
)
from nlosctl.io.paths.locations import Location, is_local, location
from nlosctl.io.writers.byte_output import try_lock, write_text, writing
from nlosctl.io.writers.locks import WriterLock

__all__ = ["MANIFEST", "RunFolder", "describe_file"]

MANIFEST = "_manifest.json"
_STATE = "_unfinished"
_PLAN = "plan.json"
_LOCK = "_lock"
_NOT_YET_LOCKED = re.compile(r"\.[0-9a-f]{16}\.part")
"""The first name of a temporary file, that of a process killed before it could lock the file."""
_STORE_CLOCK_NS = 1_000_000_000
"""Stores report times to the second, or no time (0)."""


def describe_file(root: str, name: str, rows: int) -> dict[str, Any]:
    """Return name, rows, bytes and SHA-256 of a part file of the folder ``root``."""
    path = location(root) / name
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"name": name, "rows": rows, "bytes": path.stat().st_size, "sha256": digest}


class RunFolder:
    """The folders of one run: table name -> folder; the first also keeps the state of an unfinished run.

    Until the run is finished ``_unfinished/`` contains its plan and a record of each part that is complete; at the end
    ``_manifest.json`` is written into each folder and ``_unfinished/`` is removed.
    """

    def __init__(self, roots: Mapping[str, str]) -> None:
        self.roots = {table: str(location(root)) for table, root in roots.items()}
        self.main = location(next(iter(self.roots.values())))
        self._state = self.main / _STATE
        self._replaces_manifest = False

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out of the folders, which are made if they are missing; stores have no locks.

        Raises DataError if another run writes into one of them.
        """
        for root in self.roots.values():
            with writing(root):
                _check_root(location(root))
        with ExitStack() as stack:
            for folder in map(location, self.roots.values()):
                if is_local(folder):
                    with writing(str(folder)):
                        stack.enter_context(WriterLock(folder / _LOCK, str(folder)))
            yield

    def open(
        self, plan: Mapping[str, Any], modified: Mapping[str, int], *, resume: bool, overwrite: bool
    ) -> dict[int, dict[str, Any]]:
        """Prepare the folders and return the records of the parts that are complete, by number; `locked` has them.

        ``plan`` is all that the results depend on, as plain values, its ``parts`` their names; ``modified`` is the time
        of the last change of each input (ns). Raises DataError if a folder contains something else, or (with
        ``resume``) was started with another plan or on other inputs.
        """
        self._replaces_manifest = overwrite or resume
        try:
            with writing(str(self.main)):
                return self._opened(plan, modified, resume=resume, overwrite=overwrite)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.main}: its {MANIFEST} or {_STATE}/{_PLAN} was not written by a run ({in_one_line(error)}); "
                f"name another folder"
            ) from error

    def _opened(
        self, plan: Mapping[str, Any], modified: Mapping[str, int], *, resume: bool, overwrite: bool
    ) -> dict[int, dict[str, Any]]:
        earlier = self._earlier_plan()
        if earlier is not None and resume:
            return self._resumed(earlier, json.loads(json.dumps(plan)), dict(modified))
        if earlier is not None and not overwrite:
            raise DataError(self._is_there())
        if earlier is not None:
            self._clear()
        for root in self.roots.values():
            _refuse_other_files(location(root))
        self._begin(plan, modified)
        return {}

    def keep(self, number: int, record: Mapping[str, Any]) -> None:
        """Record that a part is complete, if a run was started."""
        if self._state.is_dir():
            write_text(str(self._record_path(number)), json.dumps(sealed_record(record)), overwrite=True)

    def finish(
        self, plan: Mapping[str, Any], records: Mapping[int, Mapping[str, Any]], report: Mapping[str, Any]
    ) -> None:
        """Write the manifest of each table's folder, that of the first table last, which finishes the run."""
        parts = [records[number] for number in sorted(records)]
        with writing(str(self.main)):
            self.remove_temporary_files(plan.get("parts", []))
            for table, root in reversed(self.roots.items()):
                manifest = make_manifest(table, plan, parts, report, is_main=location(root) == self.main)
                text = json.dumps(manifest, indent=2, ensure_ascii=False)
                write_text(str(location(root) / MANIFEST), text + "\n", overwrite=self._replaces_manifest)
            self._forget_state()

    def _begin(self, plan: Mapping[str, Any], modified: Mapping[str, int]) -> None:
        for root in self.roots.values():
            location(root).mkdir(exist_ok=True)
        self._state.mkdir(exist_ok=True)
        content = json.dumps({"plan": plan, "modified": dict(modified)})
        write_text(str(self._state / _PLAN), content, overwrite=True)

    def _earlier_plan(self) -> dict[str, Any] | None:
        """Return the plan of the run in the folder, finished or not, or None without one."""
        state = _read_json(self._state / _PLAN)
        if state is not None:
            return dict(state["plan"])
        manifest = self._manifest()
        return None if manifest is None else plan_of_manifest(manifest)

    def _manifest(self) -> dict[str, Any] | None:
        manifest = _read_json(self.main / MANIFEST)
        return manifest if manifest is not None and {"parts", "inputs", "table"} <= manifest.keys() else None

    def _resumed(
        self, earlier: dict[str, Any], plan: dict[str, Any], modified: dict[str, int]
    ) -> dict[int, dict[str, Any]]:
        difference = plan_difference(earlier, plan) or self._changed_input(modified)
        if difference is not None:
            raise DataError(
                f"{self.main}: `resume`: {difference}; run it with the same options on the same inputs, or start "
                f"again with `overwrite`"
            )
        records = {number: record for number, record in self._records().items() if self._is_whole(record)}
        if not (self.main / MANIFEST).exists() or len(records) < len(plan["parts"]):
            self._begin(plan, modified)
            for number, record in records.items():
                self.keep(number, record)
            for root in self.roots.values():
                (location(root) / MANIFEST).unlink(missing_ok=True)
                for name in (name for number, name in enumerate(plan["parts"]) if number not in records):
                    if _inside(location(root), name):
                        (location(root) / name).unlink(missing_ok=True)
            self.remove_temporary_files(plan.get("parts", []))
        return records

    def _changed_input(self, modified: Mapping[str, int]) -> str | None:
        """Return a message about an input that has changed since the run was started, or finished; None without one."""
        state = _read_json(self._state / _PLAN)
        if state is not None:
            changed = [name for name, when in modified.items() if state.get("modified", {}).get(name) != when]
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
        """Return whether all files of a part are as they were written."""
        for table, root in self.roots.items():
            written = record["files"].get(table)
            if written is None or not _inside(location(root), written["name"]):
                return False
            path = location(root) / written["name"]
            if not path.is_file() or describe_file(root, written["name"], written["rows"]) != written:
                return False
        return True

    def _clear(self) -> None:
        """Remove the files of the earlier run, its manifest first; nothing else."""
        records = self._records()
        plan = self._earlier_plan() or {}
        self.remove_temporary_files(plan.get("parts", []))
        for root in self.roots.values():
            (location(root) / MANIFEST).unlink(missing_ok=True)
        names = [file["name"] for record in records.values() for file in record["files"].values()]
        for root in self.roots.values():
            for name in [*names, *plan.get("parts", [])]:
                if _inside(location(root), name):
                    (location(root) / name).unlink(missing_ok=True)
                    _remove_empty_folders(location(root), name)
        self._forget_state()

    def remove_temporary_files(self, parts: Sequence[str]) -> None:
        """Remove the temporary files of these parts whose process has ended, those without the name of a part too."""
        for root in map(location, self.roots.values()):
            paths = [root / name for name in parts if _inside(root, name)]
            begins = {f".{path.name[:100]}." for path in paths}
            for folder in dict.fromkeys(path.parent for path in paths):
                for left in _entries(folder):
                    of_part = left.name.endswith(".part") and left.name.startswith(tuple(begins))
                    if of_part or _NOT_YET_LOCKED.fullmatch(left.name):
                        _remove_if_left(left)
        for left in _entries(self._state):
            if left.name.startswith(".") and left.name.endswith(".part"):
                _remove_if_left(left)

    def _forget_state(self) -> None:
        if self._state.is_dir():
            for path in sorted(_entries(self._state), key=lambda path: path.name == _PLAN):
                path.unlink(missing_ok=True)
            self._state.rmdir()

    def _record_path(self, number: int) -> Location:
        return self._state / f"{number:06d}.json"

    def _is_there(self) -> str:
        if (self.main / MANIFEST).exists():
            return f"{self.main}: contains results already; `overwrite` replaces them"
        return f"{self.main}: contains an unfinished run; `resume` continues it, `overwrite` starts again"


def _check_root(root: Location) -> None:
    if root.exists() and not root.is_dir():
        raise DataError(f"{root}: is a file, expected a folder")
    if not is_local(root):
        if not root.has_bucket():
            raise DataError(f"{root}: there is no {str(root.top)!r}; make it first")
    elif not root.exists() and not root.parent.is_dir():
        raise DataError(f"{root}: there is no folder {str(root.parent)!r}; make it first")


def _entries(folder: Location) -> list[Location]:
    """Return the content of a folder; nothing if it does not exist."""
    if not is_local(folder):
        return [*folder.iterdir()]
    return [*folder.iterdir()] if folder.is_dir() else []


def _remove_if_left(path: Location) -> None:
    """Remove a temporary file unless it is locked, which its process does as long as it runs."""
    if is_local(path):
        with suppress(FileNotFoundError), path.open("rb") as file:
            if not try_lock(file.fileno()):
                return
    path.unlink(missing_ok=True)


def _refuse_other_files(root: Location) -> None:
    if root.is_dir():
        others = sorted(path.name for path in root.iterdir() if path.name not in (_STATE, _LOCK))
        if others:
            raise DataError(f"{root}: the folder contains other files ({others[0]!r}); name an empty or a new one")


def _read_json(path: Location) -> dict[str, Any] | None:
    """Return a JSON object, or None if it is missing or incomplete."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _inside(root: Location, name: str) -> bool:
    """Return whether a name leads to a file within the folder, symbolic links followed."""
    steps = PurePosixPath(name)
    if steps.is_absolute() or ".." in steps.parts or not steps.parts:
        return False
    return not is_local(root) or (root / name).parent.resolve().is_relative_to(root.resolve())


def _remove_empty_folders(root: Location, name: str) -> None:
    for folder in list(PurePosixPath(name).parents)[:-1]:
        with suppress(OSError):
            (root / str(folder)).rmdir()
