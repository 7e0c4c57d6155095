"""Checks of values against the contract, and the log of the bad rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.limits import LARGEST_NUMBER, LEAST_POSITIVE
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError, GatheredError, printable
from nlosctl.io.measurements.column_mapping import NULL_CODE, ColumnPlan, MappedColumn
from nlosctl.io.measurements.snapshot_ids import LostSnapshots
from nlosctl.io.paths.inputs import Input
from nlosctl.io.readers.base import BadRow, Problem, plain

__all__ = [
    "SHOWN_PROBLEMS",
    "TICKS",
    "BadRow",
    "BadRowSink",
    "Describe",
    "Fault",
    "Problem",
    "ProblemLog",
    "ReadReport",
    "RowTally",
    "ValueChecks",
    "as_float64",
    "got",
    "is_null",
    "null_mask",
    "refuse_no_rows",
]

TICKS = "ticks"
"""The times of a row batch as whole numbers, see `nlosctl.contract.windows.TICKS_PER_SECOND`."""
SHOWN_PROBLEMS = 20
_LARGEST_INTEGER = 2**63 - 1
_SLACK = 1e-6
_NO_LARGER = f"a finite number within {LARGEST_NUMBER:g}"
_FEWEST_TOO_LARGE = 5
_SHARE_TOO_LARGE = 0.1


BadRowSink = Callable[[Sequence[BadRow]], None]
"""Receives bad rows, which then do not stop the run."""


class ProblemLog:
    """Counts bad rows and keeps the first few; a ``sink`` receives them all, and the run continues."""

    def __init__(self, sink: BadRowSink | None = None) -> None:
        self.total = 0
        self.first: list[Problem] = []
        self._sink = sink

    @property
    def stops_the_run(self) -> bool:
        """Whether a bad row means that there is no result."""
        return self._sink is None

    def add(self, rows: Sequence[BadRow], total: int | None = None) -> None:
        """Add bad rows; ``total`` counts those too that are not in ``rows``."""
        self.total += len(rows) if total is None else total
        self.first.extend(row.problem for row in rows[: SHOWN_PROBLEMS - len(self.first)])
        if self._sink is not None and rows:
            self._sink(rows)

    def wanted(self) -> int | None:
        """Return how many more bad rows need a description (None: all, for the sink)."""
        return None if self._sink is not None else SHOWN_PROBLEMS - len(self.first)

    def raise_if_stopping(self) -> None:
        """Raise GatheredError with the problems, if there are any and they stop the run."""
        if self.total and self.stops_the_run:
            raise GatheredError(self.describe())

    def describe(self) -> str:
        """Return the first problems, one per line, and the total if it is larger."""
        lines = [printable(str(problem)) for problem in self.first]
        hint = "`bad_rows` FILE sets bad rows aside and continues"
        if len(lines) == self.total == 1:
            return f"{lines[0]} ({hint})"
        hidden = self.total - len(lines)
        more = f"... and {hidden} more; " if hidden else ""
        return "\n".join([*lines, f"{more}{self.total} bad rows in all; {hint}"])


@dataclass(kw_only=True)
class ReadReport:
    """Counts of what has been read so far, and remarks for the summary.

    ``rows`` are good (``left_out_rows`` of them are flagged by an earlier step), ``bad_rows`` are not.
    ``snapshots`` have been returned; all rows of ``snapshots_lost`` are bad. ``rows_by_file`` counts good and bad rows.
    ``rejoined`` are the snapshots across parts that may be several, see `nlosctl.io.measurements.returned_ids`.
    ``unused_rows`` counts the rows left out by an option of reading, by its name; ``windows`` counts windows, see
    `nlosctl.io.measurements.windows.window_tally`. ``valid_sensors`` are those of a scene with times that are valid at
    the time of some row, ``uncalibrated`` those that a calibration lacks.
    """

    rows: int = 0
    bad_rows: int = 0
    left_out_rows: int = 0
    snapshots: int = 0
    snapshots_lost: int = 0
    rows_by_file: dict[str, int] = field(default_factory=dict)
    rejoined: list[str] = field(default_factory=list)
    unused_rows: Counter[str] = field(default_factory=Counter)
    remarks: list[str] = field(default_factory=list)
    windows: Counter[str] = field(default_factory=Counter)
    valid_sensors: set[str] = field(default_factory=set)
    uncalibrated: set[str] = field(default_factory=set)

    @property
    def rows_taken(self) -> int:
        """The number of rows, good and bad, that no option leaves out."""
        return self.rows + self.bad_rows

    @property
    def rows_in_all(self) -> int:
        """The number of rows: good, bad and left out by an option."""
        return self.rows_taken + self.unused_rows.total()

    def remarks_on_all(self, scene: Scene) -> list[str]:
        """Return lines on the rows left out by options of reading, and on sensors that are valid at no row's time."""
        timed = [sensor.name for sensor in scene.sensors if sensor.start is not None or sensor.end is not None]
        never = [name for name in dict.fromkeys(timed) if name not in self.valid_sensors]
        remarks = [f"sensors of the scene that are valid for no time of the input: {', '.join(never)}"] if never else []
        if not (self.unused_rows or self.uncalibrated):
            return remarks
        from nlosctl.io.row_steps.unused_rows import option_remarks

        return [*option_remarks(self.unused_rows, self.uncalibrated), *remarks]


@dataclass(kw_only=True)
class RowTally:
    """What is counted while rows are read: bad rows, snapshots without a good row, and all rows."""

    log: ProblemLog
    lost: LostSnapshots = field(default_factory=LostSnapshots)
    report: ReadReport = field(default_factory=ReadReport)


Describe = Callable[[int], str]
"""Returns the message for the row at an index of a batch."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Rows of a batch with a fault in one column: ``mask`` (N,), and the message for a row."""

    mask: BoolArray
    column: str
    describe: Describe


class ValueChecks:
    """Checks the values in the columns of one file, and converts them to the contract's units.

    A value beyond the contract's largest magnitude is a fault of its row. If such values are at least 5 and a tenth
    of the file's rows, or more than half of them, the file is in another unit.
    """

    def __init__(self, plan: ColumnPlan, file: str) -> None:
        self._plan, self._file = plan, file
        self._too_large: dict[str, int] = {}
        self.rows = 0

    def numbers(self, mapped: MappedColumn, cells: Any, faults: list[Fault]) -> FloatArray:
        """Return numbers (N,) in the contract's unit, NaN where null; adds to ``faults``."""
        column = mapped.column
        values = as_float64(cells)
        if cells.null_count and not column.nullable:
            faults.append(Fault(mask=null_mask(cells), column=mapped.name, describe=is_null("a finite number")))
        wrong = ~np.isfinite(values)
        if column.nullable:
            wrong &= ~np.isnan(values)
        if wrong.any():
            faults.append(Fault(mask=wrong, column=mapped.name, describe=got(values, "a finite number")))
        numbers = values
        if mapped.converted:
            with ignoring_overflow():
                numbers = values * mapped.scale + mapped.offset
        if values.shape[0]:
            _check_bounds(mapped, values, numbers, faults)
            if column.largest_magnitude is not None and (column.is_bounded or not mapped.converted):
                self._check_magnitude(mapped, values, column.largest_magnitude / mapped.scale, faults)
        return numbers

    def _check_magnitude(self, mapped: MappedColumn, values: FloatArray, limit: float, faults: list[Fault]) -> None:
        largest = limit * (1.0 + _SLACK)
        if values.max() <= largest and values.min() >= -largest:  # neither if there is a NaN
            return
        beyond = (np.abs(values) > largest) & np.isfinite(values)
        if beyond.any():
            name, unit = mapped.column.name, mapped.name.rpartition("_")[2] if mapped.converted else mapped.column.unit
            if not mapped.converted:
                self._too_large[name] = self._too_large.get(name, 0) + int(beyond.sum())
            expected = f"{-limit:.4g} to {limit:.4g} {unit}"
            faults.append(Fault(mask=beyond, column=mapped.name, describe=got(values, expected)))

    def refuse_other_units(self) -> None:
        """Raise DataError if a column is in another unit than its name states; call it at the end of the file."""
        for name, count in self._too_large.items():
            many = count >= _FEWEST_TOO_LARGE and count >= _SHARE_TOO_LARGE * self.rows
            if not many and 2 * count <= self.rows:
                continue
            mapped = self._plan.mapped[name]
            column = mapped.column
            raise DataError(
                f"{self._file}, column {mapped.name!r}: {count} of {self.rows} values are beyond "
                f"±{column.largest_magnitude:.4g} {column.unit}; {column.too_large_means}"
            )

    def integers(self, mapped: MappedColumn, cells: Any, faults: list[Fault]) -> IntArray:
        """Return integers from 0 (N,), `NULL_CODE` where null; adds to ``faults``."""
        cells = plain(cells)
        if pa.types.is_uint64(cells.type):
            beyond = pc.fill_null(pc.greater(cells, pa.scalar(_LARGEST_INTEGER, pa.uint64())), False)
            if pc.any(beyond).as_py():
                huge, mask = cells, np.asarray(beyond.to_numpy(zero_copy_only=False), dtype=np.bool_)
                describe = lambda index: f"got {huge[index].as_py()}, expected at most {_LARGEST_INTEGER}"  # noqa: E731
                faults.append(Fault(mask=mask, column=mapped.name, describe=describe))
                cells = pc.if_else(beyond, pa.scalar(None, pa.uint64()), cells)
        cells = cells.cast(pa.int64())
        values = np.asarray(cells.fill_null(NULL_CODE).to_numpy(zero_copy_only=False), np.int64)
        negative = (values < 0) & ~null_mask(cells)
        if negative.any():
            describe = lambda index: f"got {values[index]}, expected an integer from 0"  # noqa: E731
            faults.append(Fault(mask=negative, column=mapped.name, describe=describe))
        return values

    def booleans(self, batch: Any, faults: list[Fault]) -> None:
        """Add a fault for integers other than 0 and 1 in the boolean columns of an Arrow batch."""
        for mapped in self._plan.mapped.values():
            if mapped.column.type != "boolean" or mapped.name not in batch.schema.names:
                continue
            cells = plain(batch.column(mapped.name))
            if pa.types.is_integer(cells.type):
                wrong = pc.invert(pc.is_in(cells, value_set=pa.array([0, 1, None], cells.type)))
                mask = np.asarray(wrong.to_numpy(zero_copy_only=False), dtype=np.bool_)
                if mask.any():
                    expected = got(as_float64(cells), "true/false or 1/0")
                    faults.append(Fault(mask=mask, column=mapped.name, describe=expected))


def _check_bounds(mapped: MappedColumn, values: FloatArray, numbers: FloatArray, faults: list[Fault]) -> None:
    """Add a fault for ``numbers`` (``values`` in the contract's unit) whose square or inverse square overflows."""
    if mapped.column.positive and not numbers.min() >= LEAST_POSITIVE:
        small = (values <= 0.0) | (numbers < LEAST_POSITIVE)
        if small.any():
            expected = f"a number larger than 0 (at least {LEAST_POSITIVE:g} {mapped.column.unit})"
            expected += f"; {mapped.column.too_small_means}" if mapped.column.too_small_means else ""
            faults.append(Fault(mask=small, column=mapped.name, describe=got(values, expected)))
    if not np.abs(numbers).max() <= LARGEST_NUMBER:
        beyond = np.isfinite(values) & (np.abs(numbers) > LARGEST_NUMBER)
        if beyond.any():
            faults.append(Fault(mask=beyond, column=mapped.name, describe=got(values, _NO_LARGER)))


def as_float64(cells: Any) -> FloatArray:
    """Return a column of numbers as floats (N,), NaN where null."""
    cells = plain(cells)
    if cells.type != pa.float64():
        cells = cells.cast(pa.float64(), safe=False)
    return np.asarray(cells.to_numpy(zero_copy_only=False), dtype=np.float64)


def null_mask(cells: Any) -> BoolArray:
    """Return where a column is null (N,)."""
    return np.asarray(pc.is_null(cells).to_numpy(zero_copy_only=False), dtype=np.bool_)


def is_null(expected: str) -> Describe:
    """Return the message for a null."""
    return lambda _: f"got an empty cell (null), expected {expected}"


def got(values: FloatArray, expected: str) -> Describe:
    """Return the message for an unexpected number in ``values`` (N,)."""
    return lambda index: f"got {'NaN' if np.isnan(values[index]) else f'{values[index]:g}'}, expected {expected}"


def refuse_no_rows(inputs: Sequence[Input], rows: int, report: ReadReport) -> None:
    """Raise DataError if none of the ``rows`` of all inputs is left by the options of reading."""
    if not rows and report.unused_rows:
        from nlosctl.io.row_steps.unused_rows import no_rows_left

        raise DataError(no_rows_left(inputs[0].name, report.unused_rows))
