"""All inputs opened once before reading: their columns and kind, their scene, and the schema for all of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.arrays import FloatArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import EARTH_PLACES, Table
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import (
    SNAPSHOT,
    ColumnPlan,
    MappedColumn,
    columns_to_read,
    coordinate_columns,
    kind_of_columns,
    kind_table,
    plan_columns,
    rename,
)
from nlosctl.io.measurements.geographic import PlaneCoordinates
from nlosctl.io.measurements.missing_columns import named_like_degrees
from nlosctl.io.measurements.row_checks import as_float64
from nlosctl.io.measurements.table_schemas import unified_schema
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.base import RecordBatch, closed_on_failure
from nlosctl.io.readers.open_file import TableFile, open_part
from nlosctl.io.scenes.scene_file import find_scene, plane_of

__all__ = ["InputSurvey", "OpenTable", "open_table", "survey_inputs"]

_TURN = 2.0 * math.pi * (1.0 + 1e-6)
_MANY_ROWS = 20
_WIDEST_DEG = 1.0
_FAR = 20.0


@dataclass(frozen=True, kw_only=True)
class OpenTable:
    """An open file of measurements, ready to be read.

    ``file_names`` are the columns to be read, ``names`` the same after renaming. ``all_names`` are all columns of the
    file, after renaming, with the positions that its latitudes and longitudes give. Results have only true ones of
    these: ``own_names``, and of those to be read the Arrow schema ``schema``, are without the others.
    """

    part: Part
    file: TableFile
    plan: ColumnPlan
    file_names: tuple[str, ...]
    names: tuple[str, ...]
    all_names: tuple[str, ...]
    own_names: tuple[str, ...]
    schema: Any

    @property
    def file_name_of(self) -> dict[str, str]:
        """The file's own name for each column to be read."""
        return dict(zip(self.names, self.file_names, strict=True))


@dataclass(kw_only=True)
class InputSurvey:
    """What is known before the first row.

    ``metadata`` are those of the first file; ``column_names`` are the columns of all files, after renaming.
    ``open_tables`` are files that stay open, by name: streams, and a single file.
    """

    table: Table
    scene: Scene
    metadata: Mapping[bytes, bytes]
    schema: Any = None
    column_names: tuple[str, ...] = ()
    open_tables: dict[str, OpenTable] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def keep_or_close(self, opened: OpenTable, *, only: bool) -> None:
        """Keep a stream open, and an ``only`` file; close any other file."""
        if only or opened.part.stream is not None:
            self.open_tables[opened.part.name] = opened
        else:
            opened.file.close()

    def close(self) -> None:
        """Close the files that are open."""
        for opened in self.open_tables.values():
            opened.file.close()
        self.open_tables.clear()


def survey_inputs(inputs: Sequence[Input], options: InputOptions) -> InputSurvey:
    """Open every file and check its columns and its scene; raise DataError or UsageError for a file that is wrong."""
    parts = [(given, part) for given in inputs for part in given.parts]
    first = parts[0][1]
    survey, opened, coordinates = _survey_first(*parts[0], options)
    with closed_on_failure(survey):
        survey.remarks += [remark for given in inputs for remark in given.remarks]
        names, schemas = [opened.own_names], [opened.schema]
        survey.remarks += opened.file.remarks
        for batch in islice(opened.file.peek(without=coordinates), 1):
            survey.remarks += _unit_remarks(batch, opened.plan.mapped, opened.file_name_of, first.name)
        survey.keep_or_close(opened, only=len(parts) == 1)
        for given, part in parts[1:]:
            opened = _open_next(given, part, options, survey, first)
            names.append(opened.own_names)
            schemas.append(opened.schema)
            survey.keep_or_close(opened, only=False)
        _check_snapshots(survey, first.name, schemas)
        survey.schema = schemas[0] if len(schemas) == 1 else unified_schema(schemas)
        survey.column_names = tuple(dict.fromkeys(name for own in names for name in own))
    return survey


def _survey_first(
    given: Input, part: Part, options: InputOptions
) -> tuple[InputSurvey, OpenTable, PlaneCoordinates | None]:
    """Open the first file, which determines the kind, the scene, and the plane on earth: the scene's, else its own."""
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        scene = _scene_of(given, part, file, options)
        table = kind_table(options.kind) if options.kind else None
        opened, coordinates = _planned(part, file, table, options, scene)
        if coordinates is not None:
            if coordinates.frame is None:
                coordinates.set_first_frame(file, part.name)
            plane_of(coordinates.frame)  # raises an error if there is no such plane
            scene = replace(scene, frame=coordinates.frame)
        return InputSurvey(table=opened.plan.table, scene=scene, metadata=file.metadata), opened, coordinates


def _open_next(given: Input, part: Part, options: InputOptions, survey: InputSurvey, first: Part) -> OpenTable:
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        if not isinstance(options.scene, str):
            _check_scene(survey.scene, _scene_of(given, part, file, options), first, part)
        opened, _ = _planned(part, file, survey.table, options, survey.scene)
        kind = kind_of_columns(opened.all_names)
        if options.kind is None and kind != survey.table.name:
            raise DataError(
                f"{part.name}: contains {kind}, but {first.name} contains {survey.table.name}; "
                f"give files of one kind, or choose it by `kind`"
            )
        return opened


def _scene_of(given: Input, part: Part, file: TableFile, options: InputOptions) -> Scene:
    """Return the scene of one file: a part of a folder without a scene may have a scene itself."""
    if isinstance(options.scene, Scene):
        scene = options.scene
    else:
        scene = find_scene(options.scene, file.metadata, given.path)
        if scene == Scene() and options.scene is None and part.path is not None:
            scene = find_scene(None, file.metadata, part.path)
    return scene if options.frame is None else replace(scene, frame=options.frame)


def _check_scene(first: Scene, other: Scene, first_part: Part, part: Part) -> None:
    if other.frame is None:
        other = replace(other, frame=first.frame)
    if other != first:
        raise DataError(
            f"{part.name}: its scene is not that of {first_part.name}; give one for all with `scene` FILE, "
            f"or run once for each file"
        )


def _check_snapshots(survey: InputSurvey, name: str, schemas: Sequence[Any]) -> None:
    with_ids = [SNAPSHOT in schema.names for schema in schemas]
    if not all(with_ids):
        survey.remarks.append("without a 'snapshot' column each input is taken as one snapshot")
    if any(with_ids) and not all(with_ids):
        raise DataError(f"{name}: some of the files have a 'snapshot' column and some don't; add it to the others")


def open_table(part: Part, table: Table, options: InputOptions, scene: Scene) -> OpenTable:
    """Open a file of measurements; raise DataError if it is unreadable or lacks columns."""
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        return _planned(part, file, table, options, scene)[0]


def _planned(
    part: Part, file: TableFile, table: Table | None, options: InputOptions, scene: Scene
) -> tuple[OpenTable, PlaneCoordinates | None]:
    """Map the columns of an open file (``table`` None: of the kind that fits best), and start reading it."""
    if options.changes_rows:
        from nlosctl.io.row_steps.added_steps import add_row_steps

        add_row_steps(file, options, part.name)
    pairs = coordinate_columns(file.names, options.columns, part.name)
    coordinates = PlaneCoordinates(pairs, scene.frame) if pairs else None
    if coordinates is not None:
        file.add_step(coordinates)
    if not file.names:
        raise DataError(f"{part.name}: no rows: the file has neither columns nor rows")
    twice = sorted(name for name, count in Counter(file.names).items() if count > 1)
    if twice:
        raise DataError(f"{part.name}: duplicate column {twice[0]!r}; rename or drop one")
    table = table or kind_table(kind_of_columns([*file.names, *options.columns], options.constants))
    names = rename(file.names, options.columns, table, part.name)
    derived = {name for pair in pairs for name in (pair.x, pair.y)}
    header = [name for name in file.names if name not in derived]
    plan = plan_columns(names, table, options.constants, scene, part.name, header)
    to_read = columns_to_read(names, plan, options.extra_columns)
    original = dict(zip(names, file.names, strict=True))
    schema = file.start(
        {original[name]: wanted for name, wanted in plan.types.items()},
        None if to_read == names else [original[name] for name in to_read],
    )
    derived = {name for name in derived if not name.startswith("truth")}
    fields = [field.with_name(name) for name, field in zip(to_read, schema, strict=True) if name not in derived]
    opened = OpenTable(
        part=part,
        file=file,
        plan=plan,
        file_names=tuple(original[name] for name in to_read),
        names=to_read,
        all_names=names,
        own_names=tuple(name for name in names if name not in derived),
        schema=pa.schema(fields),
    )
    return opened, coordinates


def _unit_remarks(
    batch: RecordBatch, mapped: Mapping[str, MappedColumn], file_name_of: Mapping[str, str], file: str
) -> list[str]:
    """Return remarks on the rows of a ``batch``: degrees read as metres, and radians read as degrees.

    ``mapped`` are the columns of the contract by name, ``file_name_of`` the file's own names of columns.
    """
    names = batch.table.schema.names
    columns = {
        name: file_name_of[column.name]
        for name, column in mapped.items()
        if file_name_of.get(column.name) in names and column.column.type == "number"
    }
    remarks = []
    for owner in EARTH_PLACES:
        x, y = columns.get(f"{owner}_x_m"), columns.get(f"{owner}_y_m")
        if x is not None and y is not None and _are_degrees(x, y, _values(batch, x), _values(batch, y)):
            remarks.append(
                f"{file}: columns {x!r} and {y!r} are read as metres, but look like longitudes and latitudes; "
                f"if they are, read them by `columns` {owner}_lon_deg={x} and `columns` {owner}_lat_deg={y}"
            )
    for name, own in columns.items():
        column = mapped[name]
        in_degrees = column.converted and column.column.unit == "rad" and "_std_" not in name
        if in_degrees and _are_radians(values := _values(batch, own)):
            certain = "are probably radians" if values.size >= _MANY_ROWS else "may be radians"
            remarks.append(
                f"{file}, column {own!r}: all {values.size} values are within 2 pi and {certain}, expected degrees; "
                f"if they are radians, read them by `columns` {name}={own}"
            )
    return remarks


def _values(batch: RecordBatch, name: str) -> FloatArray:
    column: Any = batch.table.column(name)
    return as_float64(column)


def _are_degrees(x_name: str, y_name: str, x: FloatArray, y: FloatArray) -> bool:
    """Return whether coordinates are degrees by their names, or since they are close together and far from (0, 0)."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if not x.size or np.abs(x).max() > 180.0 or np.abs(y).max() > 90.0:
        return False
    if named_like_degrees([x_name, y_name]) is not None:
        return True
    span = max(float(np.ptp(x)), float(np.ptp(y)))
    fine = np.abs(x * 10.0 - np.round(x * 10.0)) > 1e-6
    fine |= np.abs(y * 10.0 - np.round(y * 10.0)) > 1e-6
    far = math.hypot(float(x.mean()), float(y.mean()))
    return 0.0 < span <= _WIDEST_DEG and far >= _FAR * span and far > 5.0 and bool(fine.mean() > 0.5)


def _are_radians(values: FloatArray) -> bool:
    """Return whether angles are all within a turn in radians, and not whole numbers of degrees."""
    values = values[np.isfinite(values)]
    return values.size >= 2 and np.abs(values).max() <= _TURN and bool((values != np.round(values)).any())
