"""One file opened with its column plan: what it holds, under which names, in which types."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import pyarrow as pa

from nlosctl.contract.limits import size
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Table, contract_names
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import (
    SNAPSHOT,
    ColumnPlan,
    coordinate_columns,
    kind_of_columns,
    kind_table,
    plan_columns,
    rename,
)
from nlosctl.io.measurements.geographic import PlaneCoordinates
from nlosctl.io.measurements.method_flags import METHOD, are_flags_by_method
from nlosctl.io.measurements.row_checks import require_together
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import plain_type
from nlosctl.io.readers.open_file import TableFile, open_part

__all__ = ["OpenedPart", "TableOptions", "open_table", "plan_table", "unified_schema"]


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """How to open a file; see `nlosctl.io.measurements.reader.ReadOptions`."""

    renames: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    scene: Scene = field(default_factory=Scene)
    batch_rows: int = field(default_factory=partial(size, "chunk_rows"))
    use_threads: bool = True
    extra_columns: Sequence[str] | None = None


@dataclass(frozen=True, kw_only=True)
class OpenedPart:
    """An open file: ``file_names`` are its columns that are read, ``names`` the same after renaming.

    ``all_names`` are all columns of the file, after renaming.
    """

    part: Part
    source: TableFile
    plan: ColumnPlan
    file_names: tuple[str, ...]
    names: tuple[str, ...]
    all_names: tuple[str, ...]
    schema: Any
    coordinates: PlaneCoordinates | None = None

    @property
    def kept_schema(self) -> Any:
        """The schema without positions that latitudes and longitudes gave, but for true ones."""
        return pa.schema([field for field in self.schema if field.name not in self._unkept()])

    @property
    def own_names(self) -> tuple[str, ...]:
        """All columns of the file, after renaming, and true positions that latitudes and longitudes gave."""
        return tuple(name for name in self.all_names if name not in self._unkept())

    def _unkept(self) -> set[str]:
        derived = self.coordinates.names if self.coordinates is not None else ()
        return {name for name in derived if not name.startswith("truth")}

    def file_name(self, name: str) -> str:
        """Return the name that the file itself has for a column."""
        return dict(zip(self.names, self.file_names, strict=True)).get(name, name)


def open_table(part: Part, table: Table | None, options: TableOptions) -> OpenedPart:
    """Open a file and plan its columns; ``table`` None: its columns tell the kind.

    Raises DataError where the file is unreadable or lacks columns; nothing stays open then.
    """
    return plan_table(part, open_part(part, options.batch_rows, options.use_threads), table, options)


def plan_table(part: Part, source: TableFile, table: Table | None, options: TableOptions) -> OpenedPart:
    """Plan the columns of a file that is open already; as `open_table` otherwise."""
    pairs = coordinate_columns(source.names, options.renames)
    coordinates = PlaneCoordinates(pairs, options.scene.frame) if pairs else None
    if coordinates is not None:
        source.add_step(coordinates)
    try:
        return replace(_plan(part, source, table, options), coordinates=coordinates)
    except BaseException:
        source.close()
        raise


def _plan(part: Part, source: TableFile, table: Table | None, options: TableOptions) -> OpenedPart:
    if not source.names:
        raise DataError(f"{part.name}: no rows: the file has neither columns nor rows")
    twice = sorted(name for name, count in Counter(source.names).items() if count > 1)
    if twice:
        raise DataError(f"{part.name}: column {twice[0]!r} is there twice; rename or drop one")
    table = table or kind_table(kind_of_columns([*source.names, *options.renames]))
    names = rename(source.names, options.renames, table, part.name)
    plan = plan_columns(names, table, options.constants, options.scene, part.name)
    require_together(plan, part.name)
    kept = _kept(names, plan, options.extra_columns)
    original = dict(zip(names, source.names, strict=True))
    schema = source.start(
        {original[name]: wanted for name, wanted in plan.types.items()},
        None if kept == names else [original[name] for name in kept],
    )
    renamed = pa.schema([field.with_name(name) for name, field in zip(kept, schema, strict=True)], metadata=None)
    return OpenedPart(
        part=part,
        source=source,
        plan=plan,
        file_names=tuple(original[name] for name in kept),
        names=kept,
        all_names=names,
        schema=renamed,
    )


def _kept(names: tuple[str, ...], plan: ColumnPlan, extra: Sequence[str] | None) -> tuple[str, ...]:
    if extra is None:
        return names
    used = {
        found.name
        for name, found in plan.found.items()
        if not found.column.carried or name in ("los", "ip") or name == SNAPSHOT
    }
    if are_flags_by_method(names):
        used.add(METHOD)
    beginnings = tuple(name[:-1] for name in extra if name.endswith("*"))
    return tuple(name for name in names if name in used or name in extra or name.startswith(beginnings))


def unified_schema(schemas: Sequence[Any]) -> Any:
    """Return the schema that holds the columns of all: in order of first appearance, nullable, of a common type.

    Integers and floats meet as float64, integers of different sizes as int64 (uint64 in a column that the contract
    lacks: as text), anything else as text. A single schema stays as it is.
    """
    if len(schemas) == 1:
        return schemas[0]
    types: dict[str, Any] = {}
    for schema in schemas:
        for column in schema:
            held, new = types.get(column.name), plain_type(column.type)
            types[column.name] = new if held is None else _common_type(held, new, column.name in contract_names())
    return pa.schema(list(types.items()))


def _common_type(one: Any, other: Any, in_contract: bool) -> Any:
    if one == other or pa.types.is_null(other):
        return one
    if pa.types.is_null(one):
        return other
    numeric = [pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in (one, other)]
    if all(numeric) and (in_contract or not any(pa.types.is_uint64(kind) for kind in (one, other))):
        both_integers = pa.types.is_integer(one) and pa.types.is_integer(other)
        return pa.int64() if both_integers else pa.float64()
    return pa.string()
