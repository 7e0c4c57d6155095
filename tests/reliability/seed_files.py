"""Small valid files of every format and kind, which the fuzzer corrupts."""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

__all__ = ["FIXTURES", "SeedFile", "table_of", "table_seeds"]

FIXTURES = Path(__file__).parents[2] / "fixtures"

_TABLES = {
    "bearings": ("good_bearings_azimuth.csv", 18, "localize"),
    "ranges": ("good_ranges.csv", 12, "localize"),
    "triplets": ("good_triplets.csv", 15, "detect-ip"),
    "echoes": ("good_echoes.csv", 20, "identify-los"),
    "horizon": ("good_over_the_horizon.csv", 10, "localize"),
}


@dataclass(frozen=True, kw_only=True)
class SeedFile:
    """A valid file: its kind, the job that reads it, its name (with extension), its bytes.

    ``beside`` are names and bytes of files read with it, ``parameters`` are those of its importer.
    """

    target: str
    kind: str
    job: str
    name: str
    content: bytes
    beside: tuple[tuple[str, bytes], ...] = ()
    parameters: tuple[str, ...] = ()


@cache
def table_of(kind: str) -> Any:
    """Return the first rows of a fixture, text as text, with an additional text column and one of nulls."""
    name, rows, _ = _TABLES[kind]
    table = pyarrow.csv.read_csv(FIXTURES / name, convert_options=pyarrow.csv.ConvertOptions(strings_can_be_null=True))
    table = table.slice(0, rows)
    notes = pa.array([f"note {place % 3}" if place % 4 else None for place in range(rows)], pa.string())
    return table.append_column("note", notes).append_column("count", pa.array(range(rows), pa.int32()))


def _parquet(table: Any, **settings: Any) -> bytes:
    sink = io.BytesIO()
    pa.parquet.write_table(table, sink, **settings)
    return sink.getvalue()


def _arrow(table: Any, opener: Any, **settings: Any) -> bytes:
    sink = io.BytesIO()
    with opener(sink, table.schema, options=pa.ipc.IpcWriteOptions(**settings)) as writer:
        writer.write_table(table, max_chunksize=7)
    return sink.getvalue()


def _csv(table: Any) -> bytes:
    sink = io.BytesIO()
    pa.csv.write_csv(table, sink)
    return sink.getvalue()


def _json_lines(table: Any) -> bytes:
    return "".join(json.dumps(row) + "\n" for row in table.to_pylist()).encode()


def _encoded(table: Any) -> Any:
    """Return the table with its text columns dictionary-encoded."""
    for place, field in enumerate(table.schema):
        if pa.types.is_string(field.type):
            table = table.set_column(place, field.name, table.column(place).dictionary_encode())
    return table


def _files_of(kind: str) -> list[SeedFile]:
    table, job = table_of(kind), _TABLES[kind][2]
    contents = [
        ("parquet", "plain.parquet", _parquet(table, compression="none", use_dictionary=False)),
        ("parquet", "rich.parquet", _parquet(table, compression="snappy", data_page_version="2.0", row_group_size=6)),
        ("parquet", "delta.parquet", _parquet(table, compression="zstd", use_dictionary=False, write_page_index=True)),
        ("arrow", "file.arrow", _arrow(table, pa.ipc.new_file)),
        ("arrow", "lz4.arrow", _arrow(table, pa.ipc.new_file, compression="lz4")),
        ("arrow", "encoded.arrow", _arrow(_encoded(table), pa.ipc.new_file)),
        ("arrow", "stream.arrows", _arrow(table, pa.ipc.new_stream)),
        ("csv", "plain.csv", _csv(table)),
        ("csv", "crlf.csv", _csv(table).replace(b"\n", b"\r\n")),
        ("csv", "zipped.csv.gz", gzip.compress(_csv(table), mtime=0)),
        ("jsonl", "plain.jsonl", _json_lines(table)),
        ("jsonl", "zipped.jsonl.gz", gzip.compress(_json_lines(table), mtime=0)),
    ]
    return [
        SeedFile(target=target, kind=kind, job=job, name=name, content=content) for target, name, content in contents
    ]


_CONFIG = """\
[localize]
method = ["ml", "ls"]
alternatives = 2
seed = 3
strict = false
field = "sensors:2"
[localize.param]
"ml:max_iterations" = 40
"""


def table_seeds() -> tuple[SeedFile, ...]:
    """Return tables, and scenes and a config (TOML) that are read beside a valid table."""
    tables = [file for kind in _TABLES for file in _files_of(kind)]
    scenes = [
        SeedFile(target="scene", kind=kind, job="localize", name="s.toml", content=(FIXTURES / name).read_bytes())
        for kind, name in (
            ("bearings", "good_bearings.scene.toml"),
            ("bearings", "good_bearings_scene_sensors.scene.toml"),
            ("horizon", "good_over_the_horizon.scene.toml"),
        )
    ]
    config = SeedFile(target="config", kind="bearings", job="localize", name="c.toml", content=_CONFIG.encode())
    return (*tables, *scenes, config)
