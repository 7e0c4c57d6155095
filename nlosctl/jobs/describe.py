"""Job: what is in a file, before anyone solves it."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import combinations
from pathlib import PurePath
from typing import Any

from nlosctl.contract.limits import size
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.tables import FLAGS, result_table
from nlosctl.contract.windows import AUTO as AUTO_WINDOW
from nlosctl.errors import DataError, NlosctlError, UsageError
from nlosctl.io.measurements.column_mapping import SNAPSHOT
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.spooled import spooled
from nlosctl.io.readers.open_file import open_part
from nlosctl.io.results.in_memory import input_of_table
from nlosctl.jobs.console import Console, Silent
from nlosctl.jobs.files import open_inputs, require_window
from nlosctl.pipeline.convert.importer import Import, Imported
from nlosctl.pipeline.convert.recognition import AUTO
from nlosctl.pipeline.describe.commands import estimates_std, log_commands, table_commands
from nlosctl.pipeline.describe.description import Description, description_of
from nlosctl.pipeline.describe.suspicions import Suspicion

__all__ = ["describe"]

_MOST_RENAMES = 4
_NOT_RECOGNIZED = "no importer recognizes it"
_IN_DEGREES = re.compile(r"column '(\w+_rad)'.*they seem to be degrees")
_STDS = {
    "bearings": {"bearing_std_rad": 0.034906585039886591},
    "ranges": {"range_std_m": 1.0},
    "arrivals": {"arrival_std_m": 1.0},
    "triplets": {"dod_std_rad": 0.017453292519943295, "doa_std_rad": 0.017453292519943295, "path_length_std_m": 1.0},
}
"""Standard deviations for a file that states none: 2 degrees, 1 m, 1 m; of triplets 1 degree and 1 m."""


def describe(
    inputs: Sequence[str] | Sequence[Input], read: InputOptions, *, console: Console | None = None
) -> dict[str, Any]:
    """Return kind, counts, ranges of values, suspicious things and commands of a table or another program's log.

    Raises DataError if it is neither, with the reason why it is not a table.
    """
    if len(inputs) != 1:
        raise UsageError(f"describe takes one file, got {len(inputs)}")
    name = inputs[0] if isinstance(inputs[0], str) else inputs[0].name
    try:
        opened = open_inputs(inputs, read.input_format)
        with spooled(opened, read.max_spool_bytes) as given, (console or Silent()).progress("describe") as progress:
            for part in given[0].parts:
                if part.stream is not None and part.reopen is not None:
                    part.stream.close()  # each reading opens its own
            found, used = _of_table(given, read, lambda rows: progress(rows, None))
    except (DataError, UsageError) as error:
        if not isinstance(inputs[0], str) or name == "-":
            raise
        return _of_log(name, _imported(name, read, error), read)
    commands = table_commands(name, used, found, _assumed(read, used))
    return _as_dict(found, None, commands, _unstated(found, read, used))


def _of_table(
    given: Sequence[Input], read: InputOptions, progress: Callable[[int], None]
) -> tuple[Description, InputOptions]:
    """Return the description of a table, and the options that read it: constants for stds that it lacks are added.

    Columns of radians whose values are degrees are read as degrees. Raises DataError if it is not of measurements.
    """
    first: NlosctlError | None = None
    for constants in _constants():
        options = dataclasses.replace(read, constants={**constants, **read.constants}, unlabelled="marked")
        for _ in range(_MOST_RENAMES):
            try:
                return _read(given, options, progress)
            except (DataError, UsageError) as error:
                first = first or error
                degrees = _IN_DEGREES.search(str(error))
                if degrees is None:
                    break
                header = options.columns.get(degrees[1], degrees[1])
                columns = {name: own for name, own in options.columns.items() if name != degrees[1]}
                name = degrees[1].replace("_rad", "_deg")
                options = dataclasses.replace(options, columns={**columns, name: header})
    if given[0].parts[0].path is not None:
        _refuse_results(given[0])
    assert first is not None  # noqa: S101 - there is at least one attempt
    raise first


def _constants() -> Iterator[dict[str, float]]:
    """Yield sets of constant standard deviations, small ones first: none, and all subsets of those of each kind."""
    yield {}
    for stds in _STDS.values():
        for count in range(1, len(stds) + 1):
            yield from map(dict, combinations(stds.items(), count))


def _read(
    given: Sequence[Input], options: InputOptions, progress: Callable[[int], None]
) -> tuple[Description, InputOptions]:
    """Return the description, and the options with what the values ask for.

    That is the window ``auto`` where times make snapshots of several rows, and of arrivals their speed and dimensions.
    """
    found, used = _in_windows(given, options, progress)
    settings = found.spans.settings(used, found.largest)
    if settings:
        with suppress(DataError, UsageError):
            return _in_windows(given, dataclasses.replace(used, **settings), progress)
    return found, used


def _in_windows(
    given: Sequence[Input], options: InputOptions, progress: Callable[[int], None]
) -> tuple[Description, InputOptions]:
    """Return the description, and the options with the window ``auto`` where times make snapshots of several rows."""
    with _reading(given, options) as reader:
        names = reader.column_names
        if options.window is not None or SNAPSHOT in names or not {"time", "time_s"} & {*names}:
            if SNAPSHOT in names:
                require_window(options)
            return description_of(reader, progress), options
    windowed = dataclasses.replace(options, window=AUTO_WINDOW)
    with suppress(DataError, UsageError):
        found, _ = _in_windows(given, windowed, progress)
        if found.largest > 1 and not found.bad_rows:
            return found, windowed
    with _reading(given, options) as reader:
        return description_of(reader, progress), options


@contextmanager
def _reading(given: Sequence[Input], options: InputOptions) -> Iterator[MeasurementReader]:
    """Provide a reader of the inputs from their start; streams are opened again for it and closed after it."""
    inputs = [dataclasses.replace(source, parts=tuple(part.again() for part in source.parts)) for source in given]
    with ExitStack() as streams:
        for part in (part for source in inputs for part in source.parts if part.reopen is not None):
            if part.stream is not None:
                streams.callback(part.stream.close)
        yield streams.enter_context(closing(MeasurementReader(inputs, options, lambda rows: None)))


def _refuse_results(source: Input) -> None:
    """Raise DataError for a table of results."""
    part = source.parts[0].again()
    with closing(open_part(part, size("chunk_rows"), False)) as file:
        results = result_table(file.names)
    if results is not None and results is not FLAGS:
        raise DataError(
            f"{source.name}: contains {results.name}, expected measurements; see 'nlosctl evaluate' and 'plot'"
        )


def _imported(name: str, read: InputOptions, why_no_table: Exception) -> Imported:
    """Return the log that an importer recognizes; raises DataError, if none does with the reason ``why_no_table``."""
    scene = read.scene if isinstance(read.scene, str) else None
    try:
        parameters = {} if read.window is None else {"window": read.window}
        require_window(read)
        job = Import(AUTO, parameters, scene_file=scene, frame=read.frame, bad_rows=lambda rows: None, by=read.by)
        return job.read(name)
    except (DataError, UsageError) as error:
        reason = why_no_table if _NOT_RECOGNIZED in str(error) else error
        raise DataError(str(reason).splitlines()[0]) from error


def _of_log(name: str, imported: Imported, read: InputOptions) -> dict[str, Any]:
    """Return the description of a log that an importer has read; what it can't be solved for lacks commands."""
    table = f"{PurePath(name).name}.parquet"
    scene = dataclasses.replace(read, scene=imported.scene, kind=imported.kind, window=None, by=())
    found, used = None, read
    with suppress(DataError, UsageError):
        found, used = _of_table([input_of_table(imported.table)], scene, lambda rows: None)
    settings = {name: getattr(used, name) for name in ("constants", "dimensions", "speed_m_s")}
    options = dataclasses.replace(read, **settings)
    commands = log_commands(name, imported.importer, table, options, found, _assumed(read, used))
    found = found or Description(kind=imported.kind, rows=imported.table.num_rows)
    notes = [Suspicion(what="note", column=None, rows=None, text=note) for note in imported.notes]
    return _as_dict(found, imported.importer, commands, [*notes, *_unstated(found, read, used)])


def _assumed(read: InputOptions, used: InputOptions) -> list[str]:
    return [name for name in used.constants if name not in read.constants]


def _unstated(description: Description, read: InputOptions, used: InputOptions) -> list[Suspicion]:
    """Return what had to be assumed: standard deviations, and degrees in columns of radians."""
    assumed, found = _assumed(read, used), []
    if assumed:
        cure = "the commands assume values, put yours in their place"
        if estimates_std(description):
            cure = "`estimate_std` estimates it from the residuals; 'nlosctl validate' assumes a value"
        text = f"there is no {' and no '.join(assumed)}: {cure}"
        found.append(Suspicion(what="no_std", column=None, rows=None, text=text))
    if used.speed_m_s != read.speed_m_s:
        text = (
            "at the speed of light arrivals differ by more than the distance of their sensors, at that of sound they "
            "do not: set `speed_m_s` sound, or the speed at your temperature"
        )
        found.append(Suspicion(what="sound_as_light", column=None, rows=None, text=text))
    for name, header in used.columns.items():
        if name not in read.columns:
            text = f"column {header!r} contains degrees, not radians: read it by `columns` {name}={header}"
            found.append(Suspicion(what="degrees_as_radians", column=header, rows=None, text=text))
    return found


def _as_dict(
    found: Description, importer: str | None, commands: Sequence[str], further: Sequence[Suspicion]
) -> dict[str, Any]:
    bad = []
    if found.bad_rows:
        text = f"{found.bad_rows} of {found.rows} rows are bad: 'nlosctl validate' lists them; {found.first_problem}"
        bad.append(Suspicion(what="bad_rows", column=None, rows=found.bad_rows, text=text))
    return {
        "kind": found.kind,
        "importer": importer,
        "rows": found.rows,
        "snapshots": found.snapshots,
        "sensors": found.sensors,
        "time": found.times.as_dict(),
        "columns": found.values.as_dict(),
        "suspicions": [dataclasses.asdict(known) for known in (*bad, *further, *found.suspicions)],
        "commands": list(commands),
    }
