"""Import of files of other programs as tables of measurements."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from nlosctl import registry
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import EarthFrame, Scene
from nlosctl.contract.tables import KINDS
from nlosctl.errors import MethodError, NlosctlError, hide_secrets
from nlosctl.io.conversion.import_source import cut_epochs_remark, import_path, imported_table, open_import
from nlosctl.io.measurements.row_checks import BadRowSink, ProblemLog
from nlosctl.io.paths.locations import location
from nlosctl.io.scenes.scene_file import find_scene

__all__ = ["Import", "Imported", "import_hint"]


_HEAD_BYTES = 4096


@dataclass(frozen=True, kw_only=True)
class Imported:
    """A table of measurements, its kind, its scene, and remarks on its snapshots."""

    table: Any
    kind: str
    scene: Scene
    notes: tuple[str, ...] = ()


def import_hint(names: Sequence[str]) -> str:
    """Return which importer the first file of ``names`` looks like, for a message, or an empty text.

    Only built-in importers and those of plugins that can be loaded are considered.
    """
    try:
        path = location(names[0])
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES).decode("utf-8", "replace").removeprefix("\ufeff")
    except (NlosctlError, OSError, IndexError):
        return ""
    for entry in registry.format_entries():
        if entry.kind != "import":
            continue
        with suppress(NlosctlError):
            spec = registry.load_format(entry)
            if isinstance(spec, ImporterSpec) and spec.begins_like and re.match(spec.begins_like, head):
                return f"; it looks like a file for the importer {spec.name!r}: convert it by `from` {spec.name}"
    return ""


class Import:
    """Reads files by the importer ``name``; ``bad_rows`` takes lines that can't be read, else they are errors."""

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, Any],
        *,
        scene_file: str | None = None,
        frame: EarthFrame | None = None,
        bad_rows: BadRowSink | None = None,
    ) -> None:
        spec = registry.resolve_format(name, "import")
        assert isinstance(spec, ImporterSpec)  # noqa: S101 - what the registry says
        self._spec = spec
        self._options = parse_options(spec.options, parameters, f"importer {spec.name!r}")
        self._scene_file, self._frame = scene_file, frame
        self.log = ProblemLog(bad_rows)

    def read(self, source: str) -> Imported:
        """Return a file (``-`` is stdin) as a table. Raises DataError, with the lines that do not fit."""
        scene = find_scene(self._scene_file, {}, import_path(source))
        if self._frame is not None:
            scene = replace(scene, frame=self._frame)
        kind = self._spec.kind(self._options)
        name = "stdin" if source == "-" else hide_secrets(source)
        with open_import(source) as stream:
            rows = self._rows(ForeignFile(name=name, stream=stream, scene=scene))
            table = imported_table(rows, KINDS[kind], self._spec.extra, name, self.log)
        has_grid = getattr(self._options, "window", None) not in (None, "all", "auto")
        return Imported(table=table, kind=kind, scene=scene, notes=tuple(cut_epochs_remark(table) if has_grid else []))

    def _rows(self, file: ForeignFile) -> Iterator[Row | BadLine]:
        try:
            yield from self._spec.rows(file, self._options)
        except (NlosctlError, OSError):
            raise
        except Exception as error:
            raise MethodError(f"importer {self._spec.name!r} failed: {type(error).__name__}: {error}") from error
