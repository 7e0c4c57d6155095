"""Frictionless Table Schemas of the tables, generated from their declarations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nlosctl.contract.limits import LEAST_POSITIVE
from nlosctl.contract.tables import TABLES, Column, Table

__all__ = ["schema_text", "table_schema", "write_schemas"]

_LEAST_SPELLED = 5e-324
"""The smallest number above 0, for other units: validators do not read ``exclusiveMinimum``."""

_TYPES = {
    "number": "number",
    "exact": "number",
    "integer": "integer",
    "boolean": "boolean",
    "text": "string",
    "identifier": "any",
}


def table_schema(table: Table) -> dict[str, Any]:
    """Return the Table Schema of ``table``.

    ``fieldsMatch: partial`` allows missing and additional fields. Each other spelling of a column is a field. A
    column that can be replaced (by another spelling, a constant, the scene) has no ``required`` constraint, but our
    property ``optional: false``. ``unit``, ``add``, ``replaces``, ``scale`` and ``offset`` are ours too:
    ``replaced = value * scale + offset``; ``add`` is the name by which ``add`` requests a column.
    """
    return {
        "name": table.name,
        "title": table.title,
        "fieldsMatch": "partial",
        "missingValues": [""],
        "fields": [field for column in table.all_columns for field in (_field(column), *_spelled(column))],
    }


def schema_text(table: Table) -> str:
    """Return the schema as the text of its file."""
    return json.dumps(table_schema(table), indent=2, ensure_ascii=False) + "\n"


def write_schemas(folder: Path) -> list[Path]:
    """Write ``NAME.json`` for every table to ``folder``; return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for table in TABLES.values():
        path = folder / f"{table.name}.json"
        path.write_text(schema_text(table), encoding="utf-8")
        written.append(path)
    return written


def _field(column: Column) -> dict[str, Any]:
    field: dict[str, Any] = {"name": column.name, "type": _TYPES[column.type], "description": column.meaning}
    if column.unit:
        field["unit"] = column.unit
    if column.type == "boolean":
        field["trueValues"] = ["true", "True", "TRUE", "1"]
        field["falseValues"] = ["false", "False", "FALSE", "0"]
    if column.add:
        field["add"] = column.add
    field["optional"] = not column.required
    constraints = _constraints(column)
    if constraints:
        field["constraints"] = constraints
    return field


def _spelled(column: Column) -> list[dict[str, Any]]:
    """Return a field for each other spelling of a column."""
    return [
        {
            "name": spelling.name,
            "type": _TYPES[column.type],
            "description": f"replaces {column.name}{f': {spelling.meaning}' if spelling.meaning else ''}",
            "unit": spelling.name.rpartition("_")[2],
            "optional": True,
            "replaces": column.name,
            "scale": spelling.scale,
            "offset": spelling.offset,
            **({"constraints": {"minimum": _LEAST_SPELLED}} if column.positive else {}),
        }
        for spelling in column.spellings
    ]


def _constraints(column: Column) -> dict[str, Any]:
    constraints: dict[str, Any] = {}
    elsewhere = column.spellings or column.constant_allowed or column.scene_axis is not None
    if column.required and not column.nullable and not elsewhere:
        constraints["required"] = True
    if column.positive:
        constraints["minimum"] = LEAST_POSITIVE
    if column.largest_magnitude is not None:
        constraints["minimum"] = -column.largest_magnitude
        constraints["maximum"] = column.largest_magnitude
    return constraints
