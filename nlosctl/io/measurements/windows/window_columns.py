"""The columns of a file that windows need: its times, and those that part the rows."""

from __future__ import annotations

import re
from collections.abc import Sequence

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables.shared import TIMES
from nlosctl.errors import DataError, NlosctlError, UsageError, did_you_mean
from nlosctl.io.measurements.column_mapping import SNAPSHOT

__all__ = ["columns_of_windows", "time_column"]


_NEEDS_TIMES: dict[str, tuple[str, type[NlosctlError]]] = {
    "track": ("tracks, of measurements or of estimates (x_m, y_m, cov_xx_m2, ...),", DataError),
    "motion": ("velocities (motion=velocity)", UsageError),
}
"""What needs times, and the error without them, by `InputOptions.keep_times`."""


def columns_of_windows(
    names: Sequence[str], options: InputOptions, scene: Scene, file: str, header: Sequence[str]
) -> tuple[str, Sequence[str] | None]:
    """Return the column of times among a file's columns ``names`` (renamed), and the further columns to be read.

    ``header`` are the file's own names. Raises DataError if one is absent, or there is a column ``snapshot`` already.
    """
    if options.window is not None and SNAPSHOT in names:
        raise DataError(
            f"{file}: has a column 'snapshot', so that `window` cannot make snapshots; leave `window` out, or drop the "
            "column"
        )
    for name in options.by:
        if name not in names:
            raise DataError(
                f"{file}: `by` {name}: no column {name!r}{did_you_mean(name, names)}. The file has: {', '.join(header)}"
            )
    of_scene = scene.time_column and options.window is None
    purpose = "'from' and 'to' of the scene's sensors" if of_scene else "times"
    purpose, fault = _NEEDS_TIMES.get(options.keep_times, (purpose, DataError))
    extra, times = options.extra_columns, time_column(names, file, header, purpose, fault=fault)
    if scene.time_column and scene.time_column != times:
        kinds = {"time": "date-times", "time_s": "numbers"}
        raise DataError(
            f"{file}: has times in the column {times!r}, but 'from' and 'to' of the scene's sensors are "
            f"{kinds[scene.time_column]}; give them as {kinds[times]}"
        )
    return times, None if extra is None else (*extra, times, *options.by)


def time_column(
    names: Sequence[str],
    file: str,
    header: Sequence[str],
    purpose: str = "times",
    cure: str = "",
    fault: type[NlosctlError] = DataError,
) -> str:
    """Return which of the columns of times a file with the columns ``names`` has; raise DataError for both.

    Without any the ``fault`` is raised. ``purpose`` states in messages what needs them, ``cure`` how else to get them.
    """
    given = [column.name for column in TIMES if column.name in names]
    if len(given) > 1:
        raise DataError(f"{file}: columns 'time_s' and 'time' are both times; drop or rename one")
    if not given:
        raise fault(
            f"{file}: no column 'time_s' or 'time'{_near(header)}, which {purpose} need; rename one with `columns` "
            f"time_s=HEADER (seconds) or time=HEADER (ISO 8601){cure}. The file has: {', '.join(header)}"
        )
    return given[0]


def _near(header: Sequence[str]) -> str:
    near = next((name for name in header if re.search(r"time|stamp|date|epoch|utc", name, re.IGNORECASE)), None)
    return f" (is {near!r} one?)" if near else ""
