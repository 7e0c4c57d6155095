"""Import of files of other programs as tables of measurements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import IO, Any

from nlosctl import registry
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import EarthFrame, Scene
from nlosctl.contract.tables import KINDS
from nlosctl.errors import DataError, MethodError, NlosctlError, UsageError, hide_secrets
from nlosctl.io.conversion.import_source import (
    cut_epochs_remark,
    import_files,
    import_path,
    imported_table,
    open_import,
)
from nlosctl.io.measurements.row_checks import BadRowSink, ProblemLog
from nlosctl.io.scenes.scene_file import find_scene
from nlosctl.pipeline.convert.recognition import AUTO, choose_importer, import_hint, makers_of, makers_of_folder

__all__ = ["Import", "Imported"]


@dataclass(frozen=True, kw_only=True)
class Imported:
    """A table of measurements, its kind, its importer, its scene, and remarks on its snapshots."""

    table: Any
    kind: str
    importer: str
    scene: Scene
    notes: tuple[str, ...] = ()


class Import:
    """Reads files by the importer ``name`` (``auto``: the one that recognizes the file).

    ``bad_rows`` takes lines that can't be read, else they are errors; ``by`` are columns that separate windows.
    """

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, Any],
        *,
        scene_file: str | None = None,
        frame: EarthFrame | None = None,
        bad_rows: BadRowSink | None = None,
        by: Sequence[str] = (),
    ) -> None:
        self._name, self._parameters, self._by = name, parameters, tuple(by)
        self._scene_file, self._frame = scene_file, frame
        self.log = ProblemLog(bad_rows)
        if name != AUTO:
            self._resolved(name)

    def _resolved(self, name: str) -> tuple[ImporterSpec, Any]:
        """Return the importer and its options; raises UsageError for an unknown one or invalid parameters."""
        spec = registry.resolve_format(name, "import")
        assert isinstance(spec, ImporterSpec)  # noqa: S101 - what the registry says
        return spec, parse_options(spec.options, self._parameters, f"importer {spec.name!r}")

    def read(self, *sources: str) -> Imported:
        """Return a file (``-`` is stdin), or several, as one table; raise DataError with the lines that do not fit."""
        scene = find_scene(self._scene_file, {}, import_path(sources[0]))
        if self._frame is not None:
            scene = replace(scene, frame=self._frame)
        paths = [path for source in sources for path in import_files(source)]
        with ExitStack() as opened:
            streams = [opened.enter_context(open_import(path)) for path in paths]
            names = ["stdin" if path == "-" else hide_secrets(path) for path in paths]
            spec, options = self._resolved(self._chosen(sources, names, streams))
            if len(paths) > 1 and not spec.several:
                what = f"{sources[0]}: is a folder" if len(sources) == 1 else f"got {len(sources)} files"
                raise UsageError(f"{what}, expected one file: importer {spec.name!r} reads them one by one")
            kind = spec.kind(options)
            first, *more = [
                ForeignFile(name=name, stream=stream, scene=scene) for name, stream in zip(names, streams, strict=True)
            ]
            rows = _rows(spec, options, replace(first, more=tuple(more), by=self._by))
            try:
                table = imported_table(rows, KINDS[kind], spec.extra, first.name, self.log)
            except DataError as error:
                raise type(error)(f"{error}{import_hint([paths[0]], spec.name)}") from error
        has_grid = getattr(options, "window", None) not in (None, "all", "auto")
        notes = tuple(cut_epochs_remark(table) if has_grid else [])
        return Imported(table=table, kind=kind, importer=spec.name, scene=scene, notes=notes)

    def _chosen(self, sources: Sequence[str], names: Sequence[str], streams: Sequence[IO[bytes]]) -> str:
        """Return the importer of all files: the named one, or the one that recognizes them."""
        wanted = self._name if self._name == AUTO else self._resolved(self._name)[0].name
        if len(sources) == 1 < len(names):
            return choose_importer(wanted, makers_of_folder(names, streams), sources[0])
        chosen = [
            choose_importer(wanted, makers_of(stream, wanted), name)
            for name, stream in zip(names, streams, strict=True)
        ]
        for other, name in zip(chosen, names, strict=True):
            if other != chosen[0]:
                raise DataError(
                    f"{name}: is for the importer {other!r}, {names[0]} for {chosen[0]!r}; convert them separately"
                )
        return chosen[0]


def _rows(spec: ImporterSpec, options: Any, file: ForeignFile) -> Iterator[Row | BadLine]:
    try:
        yield from spec.rows(file, options)
    except (NlosctlError, OSError):
        raise
    except Exception as error:
        raise MethodError(f"importer {spec.name!r} failed: {type(error).__name__}: {error}") from error
