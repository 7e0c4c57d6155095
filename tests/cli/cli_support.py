"""Helpers for tests of the command line: runs, small files, tables."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "fixtures"
GOOD = FIXTURES / "good_bearings.parquet"
SCENE = FIXTURES / "good_bearings.scene.toml"
PROGRAM = Path(sys.executable).with_name("nlosctl")
HEADER = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The result of a run of the program."""

    code: int
    out: bytes
    err: str

    @property
    def text(self) -> str:
        """The standard output as text."""
        return self.out.decode()

    @property
    def json(self) -> Any:
        """The standard output as strict JSON."""
        return json.loads(self.out, parse_constant=_refuse)

    @property
    def table(self) -> Any:
        """The standard output as a table, from CSV."""
        return pyarrow.csv.read_csv(io.BytesIO(self.out))


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is not JSON")


def plain_environment(**extra: str) -> dict[str, str]:
    """Return the environment without settings of nlosctl, with the program's folder on the path."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("NLOSCTL", "_NLOSCTL"))}
    return {**plain, "PATH": f"{PROGRAM.parent}{os.pathsep}{plain['PATH']}", **extra}


def process(*words: Any, cwd: Path, stdin: bytes = b"", **environment: str) -> Outcome:
    """Run the program in a separate process."""
    done = subprocess.run(
        [str(PROGRAM), *map(str, words)],
        input=stdin,
        capture_output=True,
        cwd=cwd,
        env=plain_environment(**environment),
        check=False,
        timeout=60,
    )
    return Outcome(code=done.returncode, out=done.stdout, err=done.stderr.decode())


def listing(folder: Path) -> list[str]:
    """Return all names in a folder, hidden ones too."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def provenance(path: Path) -> dict[str, Any]:
    """Return the provenance in a Parquet file."""
    content: dict[str, Any] = json.loads(pyarrow.parquet.read_metadata(path).metadata[b"nlosctl"])
    return content


def read_parquet(path: Path) -> Any:
    """Return a Parquet file as a table without metadata."""
    return pyarrow.parquet.read_table(path, partitioning=None).replace_schema_metadata(None)


def plain_csv(rows: Iterable[Sequence[Any]], header: str = HEADER) -> str:
    """Return CSV text."""
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


def crossing_rows(snapshot: Any, count: int = 3) -> list[tuple[Any, ...]]:
    """Return valid rows of one snapshot: sensors along a wall, bearings that nearly meet at (2, 3)."""
    from math import atan2

    return [(snapshot, f"s{k}", float(k), 0.0, atan2(3.0, 2.0 - k) + 0.001 * (-1) ** k, 0.01) for k in range(count)]


def table_csv(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return columns as CSV text, None as an empty cell."""
    rows = zip(*columns.values(), strict=True)
    return plain_csv([["" if cell is None else cell for cell in row] for row in rows], ",".join(columns))


def good_table() -> Any:
    """Return the good bearings as a table without metadata."""
    return read_parquet(GOOD)


def write_parquet(table: Any, path: Path) -> Path:
    """Write a table and return the path."""
    pa.parquet.write_table(table, path)
    return path
