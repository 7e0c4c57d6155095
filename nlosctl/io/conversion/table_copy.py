"""Tables converted from one format to another, rows unchanged, in bounded memory, with their scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import pyarrow as pa

from nlosctl.contract.limits import size
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import FLAGS, KINDS, result_table
from nlosctl.errors import DataError
from nlosctl.io.measurements.bad_rows import bad_rows_of
from nlosctl.io.measurements.column_mapping import kind_of_columns
from nlosctl.io.measurements.row_checks import BadRowSink, ProblemLog
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.base import RecordBatch, closed_on_failure
from nlosctl.io.readers.open_file import TableFile, open_part
from nlosctl.io.row_steps.unused_rows import no_rows_left
from nlosctl.io.scenes.scene_file import SCENE_KEY, find_scene, scene_to_toml

__all__ = ["TableCopy"]


@dataclass
class TableCopy:
    """Copies the parts of one input, with the changes to rows that the options ``read`` ask for.

    ``rows`` counts the rows that have been copied, ``unused_rows`` those that an option leaves out.
    """

    given: Input
    read: InputOptions = field(default_factory=InputOptions)
    rows: int = 0
    unused_rows: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.log = ProblemLog()
        part = self.given.parts[0]
        self._source = self._opened(part)
        try:
            if not self._source.names:
                raise DataError(f"{part.name}: the table has no columns")
            twice = sorted({name for name in self._source.names if self._source.names.count(name) > 1})
            if twice:
                raise DataError(
                    f"{part.name}: column {twice[0]!r} occurs twice; rename or drop one, or name the importer of "
                    f"another program's file with `from` ('nlosctl convert' lists them)"
                )
            self._schema = self._source.start(self._types(self._source), None)
            self.scene = self._scene()
        except BaseException:
            self._source.close()
            raise

    @property
    def schema(self) -> Any:
        """The Arrow schema of the rows."""
        return self._schema

    @property
    def remarks(self) -> list[str]:
        """What the options of reading note on the file."""
        return self._source.remarks

    @property
    def metadata(self) -> dict[str, str]:
        """The provenance of the input, and its scene."""
        kept = {
            key.decode(): value.decode("utf-8", "replace")
            for key, value in self._source.metadata.items()
            if key == b"nlosctl"
        }
        return kept if self.scene == Scene() else {**kept, SCENE_KEY.decode(): scene_to_toml(self.scene)}

    def tables(self) -> Iterator[Any]:
        """Yield the rows; raise DataError at the end if some can't be read and are not set aside."""
        for part in self.given.parts:
            source = self._source
            if part is not self.given.parts[0]:
                source = self._opened(part)
                if source.names != self._source.names:
                    source.close()
                    raise DataError(
                        f"{part.name}: its columns differ from those of {self.given.parts[0].name}; convert it alone"
                    )
                source.start(self._types(source), None)
            try:
                for batch in source.batches():
                    self.unused_rows.update(batch.left_out)
                    yield self._good(part.name, batch)
            finally:
                source.close()
        self.log.raise_if_stopping()
        if not self.rows and self.unused_rows and not self.log.total:
            raise DataError(no_rows_left(self.given.name, self.unused_rows))

    def set_bad_rows_aside(self, sink: BadRowSink) -> None:
        """Send bad rows to ``sink`` and continue with the others; call it before the rows are read."""
        self.log = ProblemLog(sink)

    def close(self) -> None:
        """Close the input."""
        self._source.close()

    def _opened(self, part: Part) -> TableFile:
        file = open_part(part, size("chunk_rows"), True)
        with closed_on_failure(file):
            if self.read.changes_rows:
                from nlosctl.io.row_steps.added_steps import add_row_steps

                add_row_steps(file, self.read, part.name)
        return file

    def _scene(self) -> Scene:
        scene_file = self.read.scene if isinstance(self.read.scene, str) else None
        scene = find_scene(scene_file, self._source.metadata, self.given.path)
        return scene if self.read.frame is None else replace(scene, frame=self.read.frame)

    def _types(self, source: TableFile) -> dict[str, Any]:
        """Return the contract's types of the columns: those of a table of results, else of a kind of measurements.

        Flags have the columns of both.
        """
        results = result_table(source.names)
        tables = [results] if results is not None else []
        if results in (None, FLAGS):
            tables.append(KINDS[kind_of_columns(source.names)])
        types: dict[str, Any] = {}
        for column in (column for table in tables for column in (*table.used_columns(source.names), *table.space)):
            types.update({name: column.type for name in column.accepted_names if name in source.names})
        return types

    def _good(self, file: str, batch: RecordBatch) -> Any:
        bad: dict[int, tuple[str, str]] = {}
        for cell in batch.cell_faults:
            bad.setdefault(cell.index, (cell.column, cell.fault))
        if bad or batch.line_faults:
            self.log.add(bad_rows_of(file, batch, self._schema.names, bad))
        table = pa.Table.from_batches([batch.table]).rename_columns(self._schema.names)
        if bad:
            table = table.filter(pa.array([index not in bad for index in range(table.num_rows)]))
        self.rows += table.num_rows
        return table
