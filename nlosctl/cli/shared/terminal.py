"""What a person sees: tables, JSON and the summary. Data alone goes to stdout, the rest to stderr."""

from __future__ import annotations

import io
import json
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, TextIO, cast

from nlosctl.errors import DataError, printable

if TYPE_CHECKING:
    from nlosctl.io.writers.output_set import OutputSet

__all__ = [
    "ClosedOutput",
    "Preview",
    "Progress",
    "Terminal",
    "forget",
    "print_json",
    "print_table",
    "tell",
    "tell_report",
    "write_report",
]


def tell(text: str) -> None:
    """Tell a line (or some) on standard error; where nobody hears it, closed or full, the run goes on as it would."""
    if sys.stderr is None:
        return
    try:
        sys.stderr.write("".join(f"{printable(line)}\n" for line in text.split("\n")))
        sys.stderr.flush()
    except OSError:
        forget(sys.stderr)


def forget(stream: TextIO) -> None:
    """Leave nothing for the interpreter, or for an open writer, to flush into a pipe or disk that takes no more."""
    with suppress(AttributeError, OSError):  # a stream that is closed, or no file at all
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _UntoldFailures(io.TextIOBase):
    """A terminal that may hang up under a progress bar: what can't be shown any more is let go."""

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The terminal's."""
        return self._terminal.encoding

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self._terminal.isatty()

    def fileno(self) -> int:
        """Return the terminal's, which tells how wide it is."""
        return self._terminal.fileno()

    def write(self, text: str) -> int:
        """Show text."""
        with suppress(OSError):
            self._terminal.write(text)
        return len(text)

    def flush(self) -> None:
        """Show what waits."""
        with suppress(OSError, ValueError):  # the latter where it is closed, as when this object goes last
            self._terminal.flush()


class ClosedOutput(io.TextIOBase):
    """Stands in for a standard output that was closed: whoever writes there hears of it."""

    @property
    def buffer(self) -> NoReturn:
        """Raise DataError."""
        raise DataError("standard output is closed; name a file with -o")

    def write(self, text: str) -> NoReturn:
        """Raise DataError."""
        raise DataError("standard output is closed; there is nowhere to print to")


class Progress(Protocol):
    """Told how much of the input has been done."""

    def __call__(self, done: int, total: int | None) -> None:
        """Take the work done so far and, where it is known, the whole of it."""
        ...


class Terminal:
    """Standard error: quiet or verbose, in colour and with a progress bar only where a person is looking."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        self.quiet = quiet
        self.verbose = verbose

    def note(self, text: str) -> None:
        """Tell a line, unless quiet."""
        if not self.quiet:
            tell(text)

    def detail(self, text: str) -> None:
        """Tell a line, only when verbose."""
        if self.verbose:
            self.note(text)

    @contextmanager
    def progress(self, title: str, *, unit: str = "rows") -> Iterator[Progress]:
        """Show a progress bar with the time left while the block runs, only on a terminal."""
        if self.quiet or not _is_terminal(sys.stderr):
            yield lambda done, total: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (TextColumn(title), BarColumn(), TextColumn(f"{{task.completed:,.0f}} {unit}"), TimeRemainingColumn())
        with Bar(*columns, console=Console(file=cast(TextIO, _UntoldFailures(sys.stderr))), transient=True) as bar:
            task = bar.add_task(title, total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)


class Preview:
    """Takes a result table in place of a writer and shows its first rows on a terminal."""

    _SHOWN = 20

    def __init__(self) -> None:
        self._rows: list[dict[str, Any]] = []
        self._columns: list[str] = []
        self._total = 0

    @classmethod
    def wanted(cls, output: str, format_name: str | None) -> Preview | None:
        """Return a preview where the output would land on a terminal and no format is asked for."""
        return cls() if output == "-" and format_name is None and _is_terminal(sys.stdout) else None

    def write(self, table: Any) -> None:
        """Take rows; only the first are kept."""
        self._columns = list(table.column_names)
        self._total += table.num_rows
        missing = self._SHOWN - len(self._rows)
        if missing > 0:
            self._rows += table.slice(0, missing).to_pylist()

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Take metadata, as a writer does; a preview shows none."""

    def show(self) -> None:
        """Print the rows, and how many there are in all."""
        print_table(self._rows, self._columns)
        if self._total > len(self._rows):
            tell(f"... {len(self._rows)} of {self._total} rows; -o FILE writes all")


def write_report(target: str | None, report: Mapping[str, Any], outputs: OutputSet) -> None:
    """Write a report as JSON to a file, one of ``outputs``, where it goes to one."""
    if target not in (None, "-"):
        outputs.write_text(target, _json_text(report))


def tell_report(target: str | None, report: Mapping[str, Any]) -> None:
    """Tell a report as JSON on standard error, where it goes there (``-``)."""
    if target == "-":
        tell(_json_text(report).rstrip("\n"))


def print_json(value: object) -> None:
    """Print a value as JSON on stdout; what is not a finite number is null."""
    sys.stdout.write(_json_text(value))


def _json_text(value: object) -> str:
    return json.dumps(_finite(value), indent=2, allow_nan=False, default=str) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Print rows as a table on stdout: boxed on a terminal, plain and full width in a pipe."""
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
