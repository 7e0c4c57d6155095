"""From a batch of rows as they came to the contract's flat columns, each value checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.limits import LARGEST_NUMBER, LEAST_POSITIVE
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Column
from nlosctl.errors import DataError, did_you_mean
from nlosctl.io.measurements.bad_rows import Describe, Fault
from nlosctl.io.measurements.column_mapping import SNAPSHOT, ColumnPlan, FoundColumn
from nlosctl.io.measurements.name_codes import NULL_CODE, NameCodes
from nlosctl.io.measurements.row_checks import half_filled_faults, placement_faults
from nlosctl.io.readers.base import plain, text_at
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["Normalized", "Normalizer", "RunNames"]

_LARGEST_INTEGER = 2**63 - 1
_SLACK = 1e-6
_NO_LARGER = f"a finite number within {LARGEST_NUMBER:g}"
_FEWEST_TOO_LARGE = 5
_SHARE_TOO_LARGE = 0.1


@dataclass(frozen=True, kw_only=True)
class Normalized:
    """The contract's columns (N,) of a batch, ``left_out`` (N,), and what is wrong with which rows."""

    columns: dict[str, npt.NDArray[Any]]
    left_out: BoolArray
    faults: list[Fault]


class RunNames:
    """The codes of names that hold for a whole run: one growing set for each identifier column."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.reflectors = NameCodes(scene.reflector_names, grows=False)
        self.identifiers: dict[str, NameCodes] = {}
        self.positions_m: dict[str, tuple[float, float]] = {sensor.name: sensor.position for sensor in scene.sensors}

    def codes(self, column: str) -> NameCodes:
        """Return the codes of an identifier column."""
        return self.identifiers.setdefault(column, NameCodes())


class Normalizer:
    """Applies a column plan to the batches of one file.

    A value beyond the contract's largest magnitude is a fault of its row. Where such values are at least a tenth of
    the file's rows and five in number, or more than half of the rows, the file plainly holds another unit.
    """

    def __init__(self, plan: ColumnPlan, names: RunNames, file: str, all_rows: bool) -> None:
        self._plan, self._names, self._file, self._all_rows = plan, names, file, all_rows
        self.too_large: dict[str, int] = {}
        self.rows_seen = 0

    def normalize(self, batch: Any) -> Normalized:
        """Return the canonical columns of a record batch (columns renamed already)."""
        faults: list[Fault] = []
        columns: dict[str, npt.NDArray[Any]] = {}
        self.rows_seen += batch.num_rows
        for column in self._plan.table.columns:
            if column.carried or column.name == SNAPSHOT:
                continue
            values = self._column(column, batch, columns, faults)
            if values is not None:
                columns[column.name] = self._turned(column, values, columns)
        self._check_booleans(batch, faults)
        left_out = np.zeros(batch.num_rows, dtype=np.bool_) if self._all_rows else self._left_out(batch)
        faults += placement_faults(self._names.scene, self._plan, columns)
        faults += half_filled_faults(self._plan, columns)
        return Normalized(columns=columns, left_out=left_out, faults=faults)

    def _column(
        self, column: Column, batch: Any, done: Mapping[str, npt.NDArray[Any]], faults: list[Fault]
    ) -> npt.NDArray[Any] | None:
        found = self._plan.found.get(column.name)
        rows = batch.num_rows
        if column.scene_axis is not None and (found is None or batch.column(found.name).null_count):
            return self._from_scene(column, found, batch, done["sensor"], faults)
        if found is None:
            return self._absent(column, rows)
        cells = batch.column(found.name)
        if column.names_reflector:
            return self._reflector(found, cells, faults)
        if column.type in ("identifier", "text"):
            codes = self._names.codes(column.name).encode(cells)
            if not column.nullable and (codes == NULL_CODE).any():
                faults.append(Fault(mask=codes == NULL_CODE, column=found.name, describe=_is_null("a name")))
            return codes
        if column.type == "integer":
            return self._integers(found, cells, faults)
        return self._numbers(found, cells, faults)

    def _turned(
        self, column: Column, values: npt.NDArray[Any], done: Mapping[str, npt.NDArray[Any]]
    ) -> npt.NDArray[Any]:
        """Return directions from true north as directions in the plane; others as they are."""
        found, frame = self._plan.found.get(column.name), self._names.scene.frame
        if found is None or not found.from_north or frame is None:
            return values
        north_rad = plane_of(frame).north_rad(done["sensor_x_m"], done["sensor_y_m"])
        turned: FloatArray = values + (north_rad - 0.5 * np.pi)
        return turned

    def _absent(self, column: Column, rows: int) -> npt.NDArray[Any] | None:
        if column.name in self._plan.constants:
            return np.full(rows, self._plan.constants[column.name])
        if column.type == "number":
            return None
        return np.full(rows, NULL_CODE, dtype=np.int64)

    def _integers(self, found: FoundColumn, cells: Any, faults: list[Fault]) -> IntArray:
        cells = plain(cells)
        if pa.types.is_uint64(cells.type):
            beyond = pc.fill_null(pc.greater(cells, pa.scalar(_LARGEST_INTEGER, pa.uint64())), False)
            if pc.any(beyond).as_py():
                values, mask = cells, np.asarray(beyond.to_numpy(zero_copy_only=False), dtype=np.bool_)
                describe = lambda place: f"got {values[place].as_py()}, expected at most {_LARGEST_INTEGER}"  # noqa: E731
                faults.append(Fault(mask=mask, column=found.name, describe=describe))
                cells = pc.if_else(beyond, pa.scalar(None, pa.uint64()), cells)
        cells = cells.cast(pa.int64())
        return np.asarray(cells.fill_null(NULL_CODE).to_numpy(zero_copy_only=False), np.int64)

    def _numbers(self, found: FoundColumn, cells: Any, faults: list[Fault]) -> FloatArray:
        column = found.column
        values = _as_float64(cells)
        missing = np.isnan(values) if column.nullable or cells.null_count else None
        if cells.null_count and not column.nullable:
            faults.append(Fault(mask=_null_mask(cells), column=found.name, describe=_is_null("a finite number")))
        self._check_finite(found, values, missing, faults)
        numbers = values
        if found.converted:
            with ignoring_overflow():
                numbers = values * found.scale + found.offset
        limit = column.largest_magnitude
        self._check_bounds(found, values, numbers, faults)
        if limit is not None and not found.converted and values.shape[0]:
            self._check_size(found, values, limit, faults)
        return numbers

    def _check_bounds(self, found: FoundColumn, values: FloatArray, numbers: FloatArray, faults: list[Fault]) -> None:
        """Find numbers whose squares, or inverse squares, would leave the range of a float, whatever their unit."""
        if not values.shape[0]:
            return
        if found.column.positive and not numbers.min() >= LEAST_POSITIVE:
            small = (values <= 0.0) | (numbers < LEAST_POSITIVE)
            if small.any():
                expected = f"a number larger than 0 (at least {LEAST_POSITIVE:g} {found.column.unit})"
                faults.append(Fault(mask=small, column=found.name, describe=_got(values, expected)))
        if not np.abs(numbers).max() <= LARGEST_NUMBER:
            beyond = np.isfinite(values) & (np.abs(numbers) > LARGEST_NUMBER)
            if beyond.any():
                faults.append(Fault(mask=beyond, column=found.name, describe=_got(values, _NO_LARGER)))

    def _check_size(self, found: FoundColumn, values: FloatArray, limit: float, faults: list[Fault]) -> None:
        largest = limit * (1.0 + _SLACK)
        if values.max() <= largest and values.min() >= -largest:  # neither where there is a NaN
            return
        beyond = (np.abs(values) > largest) & np.isfinite(values)
        if beyond.any():
            name, unit = found.column.name, found.column.unit
            self.too_large[name] = self.too_large.get(name, 0) + int(beyond.sum())
            expected = f"{-limit:.4g} to {limit:.4g} {unit}"
            faults.append(Fault(mask=beyond, column=found.name, describe=_got(values, expected)))

    def _check_finite(
        self, found: FoundColumn, values: FloatArray, missing: BoolArray | None, faults: list[Fault]
    ) -> None:
        finite = np.isfinite(values)
        wrong = ~finite if missing is None else ~finite & ~missing
        if missing is not None and not found.column.nullable:
            wrong = ~finite
        if wrong.any():
            faults.append(Fault(mask=wrong, column=found.name, describe=_got(values, "a finite number")))

    def _from_scene(
        self, column: Column, found: FoundColumn | None, batch: Any, sensor: IntArray, faults: list[Fault]
    ) -> FloatArray:
        """Fill the position from the scene's sensor where the column is absent or the cell is null."""
        assert column.scene_axis is not None  # noqa: S101 - asked by the caller
        known = self._names.codes("sensor").names
        axis = [self._names.positions_m.get(name, (np.nan, np.nan))[column.scene_axis] for name in known]
        filled = np.array([*axis, np.nan])[sensor]
        name = column.name if found is None else found.name
        if found is None:
            absent = np.ones(batch.num_rows, dtype=np.bool_)
        else:
            cells = batch.column(found.name)
            own = _as_float64(cells)
            absent = _null_mask(cells)
            filled = np.where(absent, filled, own)
            beyond = ~absent & ~(np.abs(own) <= LARGEST_NUMBER)
            if beyond.any():
                faults.append(Fault(mask=beyond, column=name, describe=_got(own, _NO_LARGER)))
        unknown = absent & np.isnan(filled) & (sensor != NULL_CODE)
        if unknown.any():
            cells = batch.column(self._plan.found["sensor"].name)
            faults.append(Fault(mask=unknown, column=name, describe=self._unknown_sensor(cells)))
        return filled

    def _unknown_sensor(self, cells: Any) -> Describe:
        positions = self._names.positions_m
        if not positions:
            return _is_null("a finite number (or a scene that has the sensor)")

        def describe(place: int) -> str:
            name = text_at(cells, place) or ""
            return f"the row has no position, and the scene has no sensor {name!r}{did_you_mean(name, positions)}"

        return describe

    def _reflector(self, found: FoundColumn, cells: Any, faults: list[Fault]) -> IntArray:
        places = self._names.reflectors.encode(cells)
        unknown = places == NameCodes.UNKNOWN
        if unknown.any():
            known = self._names.scene.reflector_names

            def describe(place: int) -> str:
                name = text_at(cells, place) or ""
                if not known:
                    return f"got {name!r}, but there is no scene with reflectors; give one with --scene FILE"
                return f"the scene has no reflector {name!r}{did_you_mean(name, known)}; it has: {', '.join(known)}"

            faults.append(Fault(mask=unknown, column=found.name, describe=describe))
        return places

    def _left_out(self, batch: Any) -> BoolArray:
        out = np.zeros(batch.num_rows, dtype=np.bool_)
        for name, leaves_out in (("los", False), ("ip", True)):
            if name in self._plan.found:
                cells = plain(batch.column(self._plan.found[name].name)).cast(pa.bool_())
                out |= cells.fill_null(not leaves_out).to_numpy(zero_copy_only=False) == leaves_out
        return out

    def _check_booleans(self, batch: Any, faults: list[Fault]) -> None:
        """Find integers that are neither 0 nor 1 in the boolean columns that the batch has."""
        for found in self._plan.found.values():
            if found.column.type != "boolean" or found.name not in batch.schema.names:
                continue
            cells = plain(batch.column(found.name))
            if pa.types.is_integer(cells.type):
                wrong = pc.invert(pc.is_in(cells, value_set=pa.array([0, 1, None], cells.type)))
                mask = np.asarray(wrong.to_numpy(zero_copy_only=False), dtype=np.bool_)
                if mask.any():
                    values = _as_float64(cells)
                    faults.append(Fault(mask=mask, column=found.name, describe=_got(values, "true/false or 1/0")))

    def raise_if_too_large(self) -> None:
        """Raise DataError where a column plainly holds another unit; call it at the end of the file."""
        for name, count in self.too_large.items():
            many = count >= _FEWEST_TOO_LARGE and count >= _SHARE_TOO_LARGE * self.rows_seen
            if not many and 2 * count <= self.rows_seen:
                continue
            found = self._plan.found[name]
            column = found.column
            raise DataError(
                f"{self._file}, column {found.name!r}: {count} of {self.rows_seen} values are beyond "
                f"{column.largest_magnitude:.4g} {column.unit}, {column.too_large_means}"
            )


def _as_float64(cells: Any) -> FloatArray:
    if cells.type != pa.float64():
        if pa.types.is_dictionary(cells.type):
            cells = cells.cast(cells.type.value_type)
        cells = cells.cast(pa.float64(), safe=False)
    return np.asarray(cells.to_numpy(zero_copy_only=False), dtype=np.float64)


def _null_mask(cells: Any) -> BoolArray:
    return np.asarray(pc.is_null(cells).to_numpy(zero_copy_only=False), dtype=np.bool_)


def _is_null(expected: str) -> Describe:
    return lambda _: f"empty (null), expected {expected}"


def _got(values: FloatArray, expected: str) -> Describe:
    return lambda place: f"got {_number(float(values[place]))}, expected {expected}"


def _number(value: float) -> str:
    return "NaN" if np.isnan(value) else f"{value:g}"
