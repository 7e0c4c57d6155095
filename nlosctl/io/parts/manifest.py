"""The manifest of an output folder: inputs, options, and the content of each part file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

__all__ = ["make_manifest", "plan_difference", "plan_of_manifest", "record_of", "records_of_manifest", "sealed_record"]

_OWN = ("table", "rows", "report")
_SEAL = "sha256"


class _File(msgspec.Struct):
    name: str
    rows: int
    bytes: int
    sha256: str


class _Span(msgspec.Struct):
    first: Any
    last: Any
    ordered: bool


class _Record(msgspec.Struct):
    input: str
    rows: int
    files: dict[str, _File]
    counts: dict[str, Any]
    span: _Span


def make_manifest(
    table: str,
    plan: Mapping[str, Any],
    records: Sequence[Mapping[str, Any]],
    report: Mapping[str, Any],
    *,
    is_main: bool,
) -> dict[str, Any]:
    """Return the manifest of one table's folder as plain values, the same for equal runs.

    ``plan`` is all that the results depend on, ``records`` are the parts in order. The first table's manifest
    contains all that `records_of_manifest` returns.
    """
    parts = []
    for record in records:
        entry = {**record["files"][table], "input": record["input"]}
        parts.append({**entry, "record": sealed_record(record)} if is_main else entry)
    inputs = [{**given, "rows": record["rows"]} for given, record in zip(plan["inputs"], records, strict=True)]
    rows = sum(part["rows"] for part in parts)
    return {**plan, "table": table, "inputs": inputs, "rows": rows, "parts": parts, "report": report}


def plan_of_manifest(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the plan that a manifest was made from."""
    plan = {name: value for name, value in manifest.items() if name not in _OWN}
    plan["inputs"] = [{name: value for name, value in given.items() if name != "rows"} for given in plan["inputs"]]
    plan["parts"] = [part["name"] for part in plan["parts"]]
    return plan


def records_of_manifest(manifest: Mapping[str, Any]) -> dict[int, dict[str, Any]]:
    """Return the records in a manifest by the numbers of their parts."""
    records = {number: record_of(part.get("record")) for number, part in enumerate(manifest["parts"])}
    return {number: record for number, record in records.items() if record is not None}


def record_of(content: Any) -> dict[str, Any] | None:
    """Return the record of a part, or None if the content is not one or was changed since it was written."""
    try:
        msgspec.convert(content, _Record)
    except msgspec.ValidationError:
        return None
    record = {name: value for name, value in content.items() if name != _SEAL}
    return record if content.get(_SEAL) == _seal(record) else None


def sealed_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a part as it is written: with the SHA-256 of its content."""
    return {**record, _SEAL: _seal(record)}


def _seal(record: Mapping[str, Any]) -> str:
    as_read = json.loads(json.dumps(record))
    return hashlib.sha256(json.dumps(as_read, sort_keys=True).encode()).hexdigest()


def plan_difference(before: Any, now: Any, where: str = "") -> str | None:
    """Return a message about the first difference of two plans, or None."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*before, *(key for key in now if key not in before)]:
            difference = plan_difference(before.get(key), now.get(key), f"{where}.{key}" if where else key)
            if difference is not None:
                return difference
        return None
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, (earlier, later) in enumerate(zip(before, now, strict=True)):
            name = later.get("name", index) if isinstance(later, dict) else index
            difference = plan_difference(earlier, later, f"{where}[{name}]")
            if difference is not None:
                return difference
        return None
    return None if before == now else f"{where} was {_short(before)} and is {_short(now)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else f"{text[:77]}..."
