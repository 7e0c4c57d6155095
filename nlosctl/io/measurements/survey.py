"""All inputs opened once before reading: their kind, their scene, and the schema that holds their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Table
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import SNAPSHOT, kind_of_columns, kind_table
from nlosctl.io.measurements.mapped_file import OpenedPart, TableOptions, plan_table, unified_schema
from nlosctl.io.measurements.options import ReadOptions
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.open_file import TableFile, open_part
from nlosctl.io.scenes.scene_file import find_scene, plane_of

__all__ = ["LookAhead", "look_ahead"]


@dataclass
class LookAhead:
    """What is known before the first row.

    ``metadata`` are those of the first file; ``column_names`` are all columns of all files, renamed. ``held`` are
    the files that stay open, by name: streams, and a single file.
    """

    table: Table
    scene: Scene
    metadata: Mapping[bytes, bytes]
    options: TableOptions
    schema: Any = None
    column_names: tuple[str, ...] = ()
    held: dict[str, OpenedPart] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


def look_ahead(inputs: Sequence[Input], options: ReadOptions) -> LookAhead:
    """Open every file and check its columns and its scene; raises DataError or UsageError for what is wrong."""
    table = kind_table(options.kind) if options.kind else None
    found: LookAhead | None = None
    opened_parts = []
    names: dict[str, None] = {}
    parts = [(group, part) for group in inputs for part in group.parts]
    try:
        for group, part in parts:
            source = open_part(part, options.chunk_rows, options.use_threads)
            if found is None:
                table_options = _table_options(options, _scene_of(group, part, source, options))
                opened = plan_table(part, source, table, table_options)
                table = opened.plan.table
                table_options = _with_frame(table_options, opened)
                found = LookAhead(
                    table=table, scene=table_options.scene, metadata=source.metadata, options=table_options
                )
            else:
                if options.scene_file is None:
                    _check_scene(found.scene, _scene_of(group, part, source, options), parts[0][1], part, source)
                opened = plan_table(part, source, table, found.options)
                _check_kind(opened, found.table, parts[0][1], options)
            names.update(dict.fromkeys(opened.own_names))
            opened_parts.append(opened.kept_schema)
            if len(parts) == 1 or part.stream is not None:
                found.held[part.name] = opened
            else:
                opened.source.close()
    except BaseException:
        for held in found.held.values() if found is not None else ():
            held.source.close()
        raise
    assert found is not None  # noqa: S101 - there is at least one input
    _remark_on_snapshots(found, parts[0][1].name, opened_parts)
    found.schema = unified_schema(opened_parts)
    found.column_names = tuple(names)
    return found


def _scene_of(group: Input, part: Part, source: TableFile, options: ReadOptions) -> Scene:
    """Return the scene of one file: a part of a folder may have its own beside it where the folder has none."""
    try:
        scene = options.scene
        if scene is None:
            scene = find_scene(options.scene_file, source.metadata, group.path)
        if scene == Scene() and options.scene is None and options.scene_file is None and part.path is not None:
            scene = find_scene(None, source.metadata, part.path)
        return scene if options.frame is None else replace(scene, frame=options.frame)
    except BaseException:
        source.close()
        raise


def _with_frame(options: TableOptions, opened: OpenedPart) -> TableOptions:
    """Return the options with the plane on earth of the first file: the scene's, else about its first place."""
    step = opened.coordinates
    if step is None:
        return options
    try:
        if step.frame is None:
            step.set_first_frame(opened.source, opened.part.name)
        plane_of(step.frame)
    except BaseException:
        opened.source.close()
        raise
    return replace(options, scene=replace(options.scene, frame=step.frame))


def _check_scene(first: Scene, other: Scene, first_part: Part, part: Part, source: TableFile) -> None:
    if other.frame is None:
        other = replace(other, frame=first.frame)
    if other != first:
        source.close()
        raise DataError(
            f"{part.name}: its scene is not that of {first_part.name}; give one for all with --scene FILE, "
            f"or run once for each file"
        )


def _check_kind(opened: OpenedPart, table: Table, first_part: Part, options: ReadOptions) -> None:
    kind = kind_of_columns(opened.all_names)
    if options.kind is None and kind != table.name:
        opened.source.close()
        raise DataError(
            f"{opened.part.name}: holds {kind}, but {first_part.name} holds {table.name}; "
            f"give files of one kind, or say --kind"
        )


def _table_options(options: ReadOptions, scene: Scene) -> TableOptions:
    return TableOptions(
        renames=options.renames,
        constants=options.constants,
        scene=scene,
        batch_rows=options.chunk_rows,
        use_threads=options.use_threads,
        extra_columns=options.extra_columns,
    )


def _remark_on_snapshots(found: LookAhead, name: str, schemas: Sequence[Any]) -> None:
    with_ids = [SNAPSHOT in schema.names for schema in schemas]
    if not all(with_ids):
        found.remarks.append("without a 'snapshot' column each input is taken as one snapshot")
    if any(with_ids) and not all(with_ids):
        raise DataError(f"{name}: some of the files have a 'snapshot' column and some don't; give all one")
