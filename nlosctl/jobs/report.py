"""Job: a page that shows measurements, flags, estimates and scores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.calibration_input import is_calibration
from nlosctl.io.results.plot_inputs import PlotInput, open_plot_input
from nlosctl.io.writers.byte_output import write_bytes
from nlosctl.io.writers.output_set import check_targets
from nlosctl.jobs.files import open_inputs, require_window
from nlosctl.pipeline.report.content import report_content
from nlosctl.pipeline.report.page import page_bytes

__all__ = ["MAX_ROWS", "report"]

MAX_ROWS = 100_000
"""Rows of a file beyond which snapshots are left out of the page."""


def report(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    write: OutputOptions,
    *,
    title: str | None = None,
    max_rows: int = MAX_ROWS,
    wording: Callable[[str], str] = str,
) -> tuple[bytes, list[str]]:
    """Write the page of the inputs to the output, ``-``: only return it; return it and notes on what it leaves out.

    ``wording`` converts the notes, which name settings in backquotes. Raises DataError for faults of the files,
    UsageError without any.
    """
    if not inputs:
        raise UsageError("nothing to show; name a file of measurements, flags, estimates or scores")
    if max_rows < 1:
        raise UsageError(f"`max_rows` must be an int of at least 1. Got {max_rows} instead.")
    require_window(read)
    with _opened(inputs, read) as files:
        paths = [part.path for file in files for part in file.source.parts if part.path is not None]
        check_targets([write.output], overwrite=write.overwrite, inputs=paths)
        names = ", ".join(dict.fromkeys(file.name for file in files))
        content = report_content(
            files, read, title=names if title is None else title, max_rows=max_rows, wording=wording
        )
    page = page_bytes(content.page)
    if write.output != "-":
        write_bytes(write.output, page, overwrite=write.overwrite)
    return page, [wording(note) for note in content.notes]


@contextmanager
def _opened(inputs: Sequence[str] | Sequence[Input], read: InputOptions) -> Iterator[list[PlotInput]]:
    for name in inputs:
        if isinstance(name, str) and is_calibration(name):
            raise UsageError(f"{name}: a page has no place for a calibration; 'nlosctl plot' draws it")
    with ExitStack() as stack:
        files = []
        for source in open_inputs(inputs, read.input_format):
            files.append(open_plot_input(source, read))
            stack.callback(files[-1].close)
        yield files
