"""Output to the terminal: data go to standard output, progress and messages to standard error."""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NoReturn, TextIO, cast

from nlosctl.cli.options.settings import with_flags
from nlosctl.contract.run_options import OutputOptions
from nlosctl.contract.step_progress import watch_steps
from nlosctl.errors import DataError, hide_secrets, printable
from nlosctl.jobs.console import Progress, json_text

__all__ = [
    "ClosedOutput",
    "Preview",
    "Terminal",
    "discard",
    "preview_sinks",
    "print_json",
    "print_message",
    "print_table",
]


def print_message(text: str) -> None:
    """Print lines on standard error, settings as flags; if it is closed or full, the run continues regardless."""
    if sys.stderr is None:
        return
    try:
        sys.stderr.write("".join(f"{printable(line)}\n" for line in with_flags(hide_secrets(text)).split("\n")))
        sys.stderr.flush()
    except OSError:
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Redirect a stream to the null device, so that no later flush goes to a closed pipe or a full disk."""
    with suppress(AttributeError, OSError):  # closed, or without a file descriptor
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _ForgivingTerminal(io.TextIOBase):
    """A terminal that may hang up during a progress bar: failures to write are ignored."""

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The terminal's encoding."""
        return self._terminal.encoding

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self._terminal.isatty()

    def fileno(self) -> int:
        """Return the terminal's file descriptor, from which its width is found."""
        return self._terminal.fileno()

    def write(self, text: str) -> int:
        """Write text."""
        with suppress(OSError):
            self._terminal.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the terminal."""
        with suppress(OSError, ValueError):  # ValueError: it is closed already, as at the end of the process
            self._terminal.flush()


class ClosedOutput(io.TextIOBase):
    """Replaces a standard output that is closed: writing to it raises DataError."""

    @property
    def buffer(self) -> NoReturn:
        """Raise DataError."""
        raise DataError("standard output is closed; name a file with -o")

    def write(self, text: str) -> NoReturn:
        """Raise DataError."""
        raise DataError("standard output is closed; nothing can be printed")


class Terminal:
    """Standard error: quiet, normal or verbose; colour and a progress bar only if it is a terminal."""

    def __init__(self, quiet: bool = False, verbose: bool = False) -> None:
        self.quiet = quiet
        self.verbose = verbose

    def note(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self.quiet:
            print_message(text)

    def detail(self, text: str) -> None:
        """Print a line, only if verbose."""
        if self.verbose:
            self.note(text)

    def worded(self, text: str) -> str:
        """Return a message with the settings that it names as flags."""
        return with_flags(text)

    def show_report(self, lines: Sequence[str], report: Mapping[str, Any], write: OutputOptions) -> None:
        """Print the summary, unless quiet, and the report as JSON if ``write.report`` is ``-``."""
        for line in lines:
            self.note(line)
        if write.report == "-":
            print_message(json_text(report).rstrip("\n"))

    @contextmanager
    def progress(self, title: str, *, unit: str = "rows") -> Iterator[Progress]:
        """Show a progress bar with the remaining time while the block runs, if standard error is a terminal."""
        if self.quiet or not _is_terminal(sys.stderr):
            yield lambda done, total: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn(f"{{task.completed:,.0f}} {unit}"),
            TimeRemainingColumn(),
        )
        with Bar(*columns, console=Console(file=cast(TextIO, _ForgivingTerminal(sys.stderr))), transient=True) as bar:
            task = bar.add_task(title, total=None)

            def show_share(share: float) -> None:
                bar.update(task, description=f"{title}, {share * 100.0:.0f} % of the present step")

            with watch_steps(show_share):
                yield lambda done, total: bar.update(task, completed=done, total=total, description=title)


class Preview:
    """Receives a result table instead of a writer and shows its first rows on a terminal."""

    _SHOWN = 20

    def __init__(self) -> None:
        self._rows: list[dict[str, Any]] = []
        self._columns: list[str] = []
        self._total = 0

    @classmethod
    def wanted(cls, write: OutputOptions) -> Preview | None:
        """Return a preview if the output is a terminal and no format is requested."""
        return cls() if write.output == "-" and write.format is None and _is_terminal(sys.stdout) else None

    def write(self, table: Any) -> None:
        """Receive rows; only the first are kept."""
        self._columns = list(table.column_names)
        self._total += table.num_rows
        missing = self._SHOWN - len(self._rows)
        if missing > 0:
            self._rows += table.slice(0, missing).to_pylist()

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Receive metadata, as a writer does; a preview shows none."""

    def show(self) -> None:
        """Print the rows and the total number of rows, if a table was received."""
        if not self._columns:
            return
        if {"status", "x_m", "cov_xx_m2"} <= set(self._columns):
            rows = [_short_estimate(row) for row in self._rows]
            names = [name for name in _SHORT if any(row.get(name) != self._rows[0].get(name) for row in self._rows)]
            print_table(rows, ["snapshot", *names, *(list(rows[0])[1 + len(_SHORT) :] if rows else [])])
            print_message("-o FILE or --format csv writes all columns")
        else:
            print_table(self._rows, self._columns)
        if self._total > len(self._rows):
            print_message(f"... {len(self._rows)} of {self._total} rows; -o FILE writes all")


_SHORT = ("source", "method", "target")
_AXIS_95 = 2.447746830680816  # root of the 95 % quantile of chi-square with two degrees of freedom


def _short_estimate(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a terminal of 80 columns shows of an estimate: position, 95 % ellipse, rows used, status."""
    on_earth = "lat_deg" in row
    position = [(name, row[name]) for name in (("lat_deg", "lon_deg") if on_earth else ("x_m", "y_m"))]
    digits = 6 if on_earth else 2
    shown = {name: "" if value is None else f"{value:.{digits}f}" for name, value in position}
    xx, xy, yy = (row[f"cov_{entry}_m2"] for entry in ("xx", "xy", "yy"))
    ellipse = ""
    if None not in (xx, xy, yy):
        middle, apart = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        axes = (_AXIS_95 * math.sqrt(max(value, 0.0)) for value in (middle + apart, middle - apart))
        ellipse = " x ".join(f"{axis:.3g}" for axis in axes)
    used = f"{row['n_used']}/{row['n_measurements']}"
    return {
        "snapshot": row["snapshot"],
        **{name: row.get(name) for name in _SHORT},
        **shown,
        "95% ellipse": ellipse and f"{ellipse} m",
        "used": used,
        "status": row["status"],
    }


@contextmanager
def preview_sinks(table: str, write: OutputOptions) -> Iterator[dict[str, Callable[..., Any]]]:
    """Provide the sinks of a job: a preview of the main ``table`` if that is wanted, shown when the block ends."""
    preview = Preview.wanted(write)
    yield {} if preview is None else {table: lambda *_: preview}
    if preview is not None:
        preview.show()


def print_json(value: object) -> None:
    """Print a value as JSON on standard output; a number that is not finite becomes null."""
    sys.stdout.write(json_text(value))


def print_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Print rows as a table on standard output: boxed on a terminal, plain and full width in a pipe."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD if sys.stdout.isatty() else None, pad_edge=False)
    for name in columns:
        table.add_column(printable(name), justify="right" if _numeric(rows, name) else "left", overflow="fold")
    for row in rows:
        table.add_row(*(_cell(row.get(name)) for name in columns))
    Console(width=None if sys.stdout.isatty() else 1000, markup=False, highlight=False).print(table)


def _is_terminal(stream: TextIO | None) -> bool:
    return stream is not None and stream.isatty()


def _numeric(rows: Sequence[Mapping[str, Any]], name: str) -> bool:
    return any(isinstance(row.get(name), int | float) for row in rows)


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return printable(str(value))
