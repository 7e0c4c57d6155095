"""Arguments of the functions: tables of any library, paths, standard deviations, bad rows; and results in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.flags import parse_speed
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import KINDS
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input, expand_inputs
from nlosctl.io.results.in_memory import gather, input_of_table, read_table

__all__ = ["BadRows", "SceneLike", "TableSink", "input_options", "inputs_of", "names_of", "row_options", "set_aside"]

_WINDOWS = ("window", "window_keep", "timezone", "max_sort_rows")

SceneLike = Scene | str | PathLike[str] | None
BadRows = bool | str | PathLike[str] | None


def inputs_of(table: Any) -> list[Input]:
    """Return a table, the path of a file, folder or glob, or a list of paths as inputs for the readers."""
    if isinstance(table, str | PathLike):
        return expand_inputs([fspath(table)])
    if isinstance(table, list | tuple) and table and all(isinstance(path, str | PathLike) for path in table):
        return expand_inputs([fspath(path) for path in table])
    return [input_of_table(table)]


def input_options(
    columns: Mapping[str, str] | None,
    constants: Mapping[str, float] | None,
    scene: SceneLike,
    keywords: dict[str, Any],
    **rest: Any,
) -> InputOptions:
    """Return the options of reading.

    Standard deviations are moved from ``keywords`` to the constants, in radians. ``dimensions``, ``speed_m_s``
    (or its name), ``speed_std_m_s`` and the options of `row_options` are taken from them too.
    """
    given = dict(constants or {})
    scales = _scales()
    for name in [name for name in keywords if name in scales]:
        if name in given:
            raise UsageError(f"{name!r} is given twice; give it alone, or in `constants`")
        given[name] = keywords.pop(name)
    converted: dict[str, float] = {}
    for name, value in given.items():
        standard, scale = scales.get(name, (name, 1.0))
        if standard in converted:
            raise UsageError(f"{standard!r} is given in two units; give one")
        converted[standard] = _number(name, value) * scale
    scene = scene if scene is None or isinstance(scene, Scene) else fspath(scene)
    rest |= row_options(keywords)
    if "dimensions" in keywords:
        rest["dimensions"] = keywords.pop("dimensions")
    if "speed_std_m_s" in keywords:
        rest["speed_std_m_s"] = _number("speed_std_m_s", keywords.pop("speed_std_m_s"))
    calibration = keywords.pop("calibration", None)
    rest["calibration"] = calibration if isinstance(calibration, Calibration | None) else fspath(calibration)
    if "speed_m_s" in keywords:
        rest["speed_m_s"] = parse_speed(str(keywords.pop("speed_m_s")))
    return InputOptions(columns=dict(columns or {}), constants=converted, scene=scene, **rest)


def row_options(keywords: dict[str, Any]) -> dict[str, Any]:
    """Return the options that change rows and that make snapshots of times, removed from ``keywords``.

    They are ``wide missing where declination_deg`` and ``window by window_keep timezone max_sort_rows``.
    """
    given: dict[str, Any] = {name: keywords.pop(name) for name in _WINDOWS if name in keywords}
    for name in ("wide", "missing", "where", "by"):
        values = keywords.pop(name, ())
        given[name] = tuple(map(str, [values] if isinstance(values, str | int | float) else values))
    return given | {"declination_deg": keywords.pop("declination_deg", None)}


def _scales() -> dict[str, tuple[str, float]]:
    """Return the standard name and the unit of every accepted name of a constant."""
    scales = {}
    for column in (column for table in KINDS.values() for column in table.all_columns if column.constant_allowed):
        scales[column.name] = (column.name, 1.0)
        for spelling in column.spellings:
            by_speed = (column.name.replace("_std_m", "_std_s"), spelling.seconds)
            scales[spelling.name] = by_speed if spelling.seconds else (column.name, spelling.scale)
    return scales


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise UsageError(f"{name!r} must be a number, one for all rows. Got {type(value).__name__} instead.") from None


def names_of(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return one name or several as a tuple."""
    return (names,) if isinstance(names, str) else tuple(names)


@dataclass(frozen=True)
class _Aside:
    """The file of bad rows, and whether it is read back into a table."""

    path: str | None
    in_memory: bool

    @property
    def options(self) -> dict[str, Any]:
        """The setting of the output options."""
        return {} if self.path is None else {"bad_rows": self.path, "overwrite": self.in_memory}

    def tables(self) -> dict[str, Any]:
        """Return the table of bad rows if it is wanted."""
        return {"bad_rows": read_table(self.path)} if self.in_memory and self.path is not None else {}


@contextmanager
def set_aside(bad_rows: BadRows) -> Iterator[_Aside]:
    """Provide a place for bad rows: None, a file, or (True) a temporary one that becomes a table."""
    if bad_rows is True:
        with tempfile.TemporaryDirectory() as folder:
            yield _Aside(str(Path(folder) / "bad_rows.parquet"), in_memory=True)
    else:
        yield _Aside(fspath(bad_rows) if bad_rows else None, in_memory=False)


class TableSink:
    """A sink that keeps the tables of a job in memory."""

    def __init__(self) -> None:
        self._tables: list[Any] = []
        self._schema: Any = None
        self._metadata: Mapping[str, str] | None = None

    def start(self, schema: Any, metadata: Mapping[str, str] | None = None) -> TableSink:
        """Set the schema of the following tables, and the metadata of the whole; return the sink."""
        self._schema, self._metadata = schema, metadata
        return self

    def write(self, table: Any) -> None:
        """Receive rows."""
        self._tables.append(table)

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Ignore the metadata that only files have."""

    def table(self) -> Any:
        """Return all rows as one table."""
        return gather(self._tables, self._schema, self._metadata)
