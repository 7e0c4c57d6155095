"""All inputs opened once before reading: their columns and kind, their scene, and the schema for all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Table
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import (
    SNAPSHOT,
    ColumnPlan,
    columns_to_read,
    coordinate_columns,
    kind_of_columns,
    kind_table,
    plan_columns,
)
from nlosctl.io.measurements.geographic import PlaneCoordinates
from nlosctl.io.measurements.missing_columns import is_of_one_station, measured_names, rename, usable_defaults
from nlosctl.io.measurements.table_schemas import unified_schema, unlabelled_table
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.base import closed_on_failure
from nlosctl.io.readers.open_file import TableFile, open_part
from nlosctl.io.scenes.scene_file import find_scene, plane_of

__all__ = ["InputSurvey", "OpenTable", "open_table", "survey_inputs"]


@dataclass(frozen=True, kw_only=True)
class OpenTable:
    """An open file of measurements, ready to be read.

    ``file_names`` are the columns to be read, ``names`` the same after renaming. ``all_names`` are all columns of the
    file, after renaming, with the positions that its latitudes and longitudes give. Results have only true ones of
    these: ``own_names``, and of those to be read the Arrow schema ``schema``, are without the others. ``one_station``
    marks a file without a column ``sensor``. ``time_column`` is the column of times, empty if they are not needed;
    ``timezone`` is that of times without an offset.
    """

    part: Part
    file: TableFile
    plan: ColumnPlan
    file_names: tuple[str, ...]
    names: tuple[str, ...]
    all_names: tuple[str, ...]
    own_names: tuple[str, ...]
    schema: Any
    one_station: bool = False
    time_column: str = ""
    timezone: str | None = None
    remarks: Sequence[str] = ()

    @property
    def file_name_of(self) -> dict[str, str]:
        """The file's own name for each column to be read."""
        return dict(zip(self.names, self.file_names, strict=True))


@dataclass(kw_only=True)
class InputSurvey:
    """What is known before the first row.

    ``metadata`` are those of the first file; ``column_names`` are the columns of all files, after renaming.
    ``open_tables`` are files that stay open, by name: streams, and a single file. ``one_station``: the files lack a
    column ``sensor``. ``measured_columns`` are the contract's in the first file. ``constants`` are those that some
    file needs, by column; ``units`` are unknown std.
    """

    table: Table
    scene: Scene
    metadata: Mapping[bytes, bytes]
    schema: Any = None
    column_names: tuple[str, ...] = ()
    open_tables: dict[str, OpenTable] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    time_column: str = ""
    one_station: bool = False
    measured_columns: frozenset[str] = frozenset()
    constants: dict[str, float] = field(default_factory=dict)
    units: Mapping[str, float] = field(default_factory=dict)

    def keep_or_close(self, opened: OpenTable, *, only: bool) -> None:
        """Keep a stream open, and an ``only`` file; close any other file."""
        if only or opened.part.stream is not None:
            self.open_tables[opened.part.name] = opened
        else:
            opened.file.close()

    def close(self) -> None:
        """Close the files that are open."""
        while self.open_tables:
            self.open_tables.popitem()[1].file.close()


def survey_inputs(inputs: Sequence[Input], options: InputOptions) -> InputSurvey:
    """Open every file and check its columns and its scene; raise DataError or UsageError for a file that is wrong."""
    parts = [(given, part) for given in inputs for part in given.parts]
    first = parts[0][1]
    survey, opened, coordinates = _survey_first(*parts[0], options)
    with closed_on_failure(survey):
        survey.remarks += [remark for given in inputs for remark in given.remarks]
        names, schemas, stations = [opened.own_names], [opened.schema], [opened.one_station]
        survey.remarks += [*opened.remarks, *opened.file.remarks]
        for batch in islice(opened.file.peek(without=coordinates), 1):
            if _could_be_in_other_units(batch.table, opened.plan, opened.file_name_of):
                from nlosctl.io.measurements.row_consistency import unit_remarks

                survey.remarks += unit_remarks(batch, opened.plan, opened.file_name_of, survey.scene, first.name)
        survey.keep_or_close(opened, only=len(parts) == 1)
        for given, part in parts[1:]:
            from nlosctl.io.measurements.further_files import open_next

            opened = open_next(given, part, options, survey, first)
            names.append(opened.own_names)
            schemas.append(opened.schema)
            stations.append(opened.one_station)
            survey.keep_or_close(opened, only=False)
        if options.window is None:
            _check_snapshots(survey, first.name, schemas)
        _check_stations(survey, first.name, stations)
        survey.remarks += _without_effect(survey, options, {name for own in names for name in own})
        survey.schema = schemas[0] if len(schemas) == 1 else unified_schema(schemas)
        survey.column_names = tuple(dict.fromkeys(name for own in names for name in own))
    return survey


def _could_be_in_other_units(table: Any, plan: ColumnPlan, file_name_of: Mapping[str, str]) -> bool:
    """Return whether a column is of degrees, or could be: coordinates within 180, standard deviations above a half."""
    mapped = plan.mapped.values()
    if "sensor_x_m" not in plan.mapped or any(given.converted or given.column.unit == "deg" for given in mapped):
        return True
    for name in (name for name in plan.mapped if name.endswith(("_x_m", "_std_rad"))):
        own = file_name_of.get(plan.mapped[name].name)
        if own in table.schema.names and table.num_rows > table.column(own).null_count:
            extremes = pc.min_max(table.column(own))
            least, most = extremes["min"].as_py(), extremes["max"].as_py()
            if least > 0.5 if name.endswith("_std_rad") else max(-least, most) <= 180.0:
                return True
    return False


def _survey_first(
    given: Input, part: Part, options: InputOptions
) -> tuple[InputSurvey, OpenTable, PlaneCoordinates | None]:
    """Open the first file, which determines the kind, the scene, and the plane on earth: the scene's, else its own."""
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        scene = scene_of(given, part, file, options)
        opened, coordinates = planned(part, file, None, options, scene)
        if coordinates is not None:
            if coordinates.frame is None:
                coordinates.set_first_frame(file, part.name)
            plane_of(coordinates.frame)  # raises an error if there is no such plane
            scene = replace(scene, frame=coordinates.frame_of(opened.plan.table.dimension))
        survey = InputSurvey(table=opened.plan.table, scene=scene, metadata=file.metadata, units=opened.plan.units)
        survey.constants |= opened.plan.constants
        survey.measured_columns = frozenset(opened.plan.mapped)
        survey.time_column = opened.time_column
        return survey, opened, coordinates


def scene_of(given: Input, part: Part, file: TableFile, options: InputOptions) -> Scene:
    """Return the scene of one file: a part of a folder without a scene may have a scene itself."""
    if isinstance(options.scene, Scene):
        scene = options.scene
    else:
        scene = find_scene(options.scene, file.metadata, given.path)
        if scene == Scene() and options.scene is None and part.path is not None:
            scene = find_scene(None, file.metadata, part.path)
    return scene if options.frame is None else replace(scene, frame=options.frame)


def _without_effect(survey: InputSurvey, options: InputOptions, names: Collection[str]) -> list[str]:
    """Return remarks on options that change nothing about files with the columns ``names``."""
    remarks = []
    if options.all_rows and not {"los", "ip"} & set(names):
        remarks.append("`all_rows` has no effect: the input has no column los or ip of an earlier step")
    return remarks + [
        f"`constants[{std!r}]` has no effect: the {survey.table.name} have no column {measured[0]!r}"
        for std in options.constants
        if std not in survey.table.space_names and set(measured := measured_names(std, survey.table)).isdisjoint(names)
    ]


def _check_snapshots(survey: InputSurvey, name: str, schemas: Sequence[Any]) -> None:
    with_ids = [SNAPSHOT in schema.names for schema in schemas]
    if not all(with_ids):
        survey.remarks.append("without a 'snapshot' column each input is taken as one snapshot")
    if any(with_ids) and not all(with_ids):
        raise DataError(f"{name}: some of the files have a 'snapshot' column and some don't; add it to the others")


def _check_stations(survey: InputSurvey, name: str, stations: Sequence[bool]) -> None:
    survey.one_station = all(stations)
    if survey.one_station:
        numbered = "; repeated readings are numbered" if survey.table.row_key else ""
        survey.remarks.append(f"without a 'sensor' column all rows are of one station{numbered}")
    elif any(stations):
        raise DataError(f"{name}: some of the files have a 'sensor' column and some don't; add it to the others")


def open_table(part: Part, table: Table, options: InputOptions, scene: Scene) -> OpenTable:
    """Open a file of measurements; raise DataError if it is unreadable or lacks columns."""
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        return planned(part, file, table, options, scene)[0]


def planned(
    part: Part, file: TableFile, table: Table | None, options: InputOptions, scene: Scene
) -> tuple[OpenTable, PlaneCoordinates | None]:
    """Map the columns of an open file and start reading it; ``table`` None: that of its kind and dimension."""
    coordinates, derived, one_station = _add_steps(part, file, options, scene)
    if not file.names:
        raise DataError(f"{part.name}: no rows: the file has neither columns nor rows")
    twice = sorted(name for name, count in Counter(file.names).items() if count > 1)
    if twice:
        raise DataError(f"{part.name}: duplicate column {twice[0]!r}; rename or drop one")
    is_first, given = table is None, {*options.constants, *options.default_constants}
    if table is None and options.unlabelled:
        table = unlabelled_table(options, [*file.names, *options.columns])
    table = table or kind_table(options.kind or kind_of_columns([*file.names, *options.columns], given))
    needs_times = bool(scene.time_column) or options.window is not None or bool(options.keep_times)
    table = table.with_further(times=needs_times, headings=getattr(options.calibration, "harmonics", 0) > 0)
    names = rename(file.names, options.columns, table, part.name) if options.columns else tuple(file.names)
    remarks: Sequence[str] = ()
    if is_first and (options.dimensions is not None or not table.space_names.isdisjoint([*names, *given])):
        from nlosctl.io.measurements.dimensions import in_dimension

        needs_stds = options.missing_std != "unit"
        table, remarks = in_dimension(table, names, given, scene, part.name, options.dimensions, needs_stds=needs_stds)
    header = [name for name in file.names if name not in derived and not (one_station and name == "sensor")]
    defaults = options.default_constants and usable_defaults(options.default_constants, names, table)
    own = {name: value for name, value in options.constants.items() if name not in table.space_names}
    constants = {**defaults, **own}
    plan = plan_columns(names, table, constants, scene, part.name, header, options.missing_std)
    if table.dimension == 3 or table.name == "arrivals" or options.speed_std_m_s:
        from nlosctl.io.measurements.completion.completed_rows import completed_plan

        plan = completed_plan(plan, header, part.name, options)
    extra, time_column = options.extra_columns, ""
    if needs_times:
        from nlosctl.io.measurements.windows.window_columns import columns_of_windows

        time_column, extra = columns_of_windows(names, options, scene, part.name, header)
    to_read = columns_to_read(names, plan, extra)
    original = dict(zip(names, file.names, strict=True))
    columns = None if to_read == names else [original[name] for name in to_read]
    schema = file.start({original[name]: wanted for name, wanted in plan.types.items()}, columns)
    derived -= {name for name in derived if name.startswith("truth")}
    fields = [field.with_name(name) for name, field in zip(to_read, schema, strict=True) if name not in derived]
    return OpenTable(
        part=part,
        file=file,
        plan=plan,
        file_names=tuple(original[name] for name in to_read),
        names=to_read,
        all_names=names,
        own_names=tuple(name for name in names if name not in derived),
        schema=pa.schema(fields),
        one_station=one_station,
        time_column=time_column,
        timezone=options.timezone,
        remarks=remarks,
    ), coordinates


def _add_steps(
    part: Part, file: TableFile, options: InputOptions, scene: Scene
) -> tuple[PlaneCoordinates | None, set[str], bool]:
    """Add the steps that change rows, name a lone station, or place latitudes in the plane, in this order.

    Return the last one, if any, the columns that they derive, and whether the rows are of one station.
    """
    derived: set[str] = set()
    if options.changes_rows or "unit_x" in file.names or "unit_x" in options.columns:
        from nlosctl.io.row_steps.added_steps import add_row_steps

        derived |= add_row_steps(file, options, part.name)
    pairs = coordinate_columns(file.names, options.columns, part.name)
    derived |= {name for pair in pairs for name in (pair.x, pair.y)}
    coordinates = PlaneCoordinates(pairs, scene.frame) if pairs else None
    names = {*file.names, *derived, *options.columns}
    one_station = "sensor" not in names and is_of_one_station(names, scene)
    if one_station:
        from nlosctl.io.measurements.one_station import OneStation

        file.add_step(OneStation(scene))
    if coordinates is not None:
        file.add_step(coordinates)
    return coordinates, derived, one_station
