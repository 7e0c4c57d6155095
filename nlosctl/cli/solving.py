"""What the commands share that solve measurements: run the methods, write the tables, tell the summary."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nlosctl.cli.reading import Opened, open_output
from nlosctl.cli.terminal import Preview, Terminal, tell, write_report

if TYPE_CHECKING:
    from nlosctl.io.write import TableWriter
    from nlosctl.pipeline.run import MeasurementRun

__all__ = ["Outputs", "exit_code", "solve_and_write"]

_NOTHING_TO_DO = 1
_UNANSWERED = 3


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Where the tables go: ``main`` and, if named, ``other`` and ``trace``; whether the first is the estimates."""

    main: str
    other: str | None
    estimates_first: bool
    format: str | None
    overwrite: bool
    with_hash: bool
    report: str | None
    trace: str | None = None


def solve_and_write(run: MeasurementRun, opened: Opened, outputs: Outputs, command: str, terminal: Terminal) -> None:
    """Run to the end, write both tables, tell the summary on standard error and in the report file."""
    preview = Preview.wanted(outputs.main, outputs.format)
    schemas = (run.estimates_schema, run.flags_schema)
    main_schema, other_schema = schemas if outputs.estimates_first else schemas[::-1]
    metadata = run.metadata(command, opened.inputs, with_hash=outputs.with_hash)
    with ExitStack() as stack:

        def open_sink(target: str, schema: Any, format: str | None) -> TableWriter:
            return stack.enter_context(
                open_output(
                    target,
                    schema,
                    format_name=format,
                    overwrite=outputs.overwrite,
                    inputs=opened.paths,
                    metadata=metadata,
                )
            )

        main = preview or open_sink(outputs.main, main_schema, outputs.format)
        other = None if outputs.other is None else open_sink(outputs.other, other_schema, outputs.format)
        trace = None if outputs.trace is None else open_sink(outputs.trace, run.trace_schema, outputs.format)
        progress = stack.enter_context(terminal.progress(command))
        rows = 0
        for tables in run.tables():
            both = (tables.estimates, tables.flags)
            first, second = both if outputs.estimates_first else both[::-1]
            main.write(first)
            if other is not None:
                other.write(second)
            if trace is not None:
                trace.write(tables.trace)
            rows += tables.rows
            progress(rows, None)
        closing = run.metadata(command, opened.inputs, with_hash=outputs.with_hash)
        for sink in (main, other, trace):
            if sink is not None:
                sink.set_metadata(closing)
    if preview is not None:
        preview.show()
    for line in run.report.lines():
        terminal.note(line)
    if outputs.report is not None:
        write_report(outputs.report, run.report.as_dict())


def exit_code(run: MeasurementRun, *, strict: bool = False) -> int:
    """Return how the command ends after a run: 1 where every row was bad, 3 where ``strict`` misses an estimate."""
    if not run.report.snapshots:
        tell("nlosctl: nothing to do: every row is bad")
        return _NOTHING_TO_DO
    return _UNANSWERED if strict and run.report.unanswered else 0
