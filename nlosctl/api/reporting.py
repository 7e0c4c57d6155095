"""The function that makes a page, and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from os import PathLike, fspath
from typing import Any

from nlosctl.api.tables import SceneLike, input_options, inputs_of
from nlosctl.contract.run_options import OutputOptions
from nlosctl.errors import UsageError
from nlosctl.io.writers.byte_output import write_bytes
from nlosctl.io.writers.output_set import check_targets
from nlosctl.jobs import report as report_job

__all__ = ["Report", "report"]


@dataclass(frozen=True, repr=False)
class Report:
    """A page as ``html``, which a notebook shows in a frame, and ``notes`` on what it leaves out."""

    html: str
    notes: Sequence[str]

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the page; raises DataError for an existing file."""
        check_targets([fspath(path)], overwrite=overwrite, inputs=[])
        write_bytes(fspath(path), self.html.encode("utf-8"), overwrite=overwrite)

    def __repr__(self) -> str:
        return f"Report of {len(self.html) / 1e6:.1f} MB; .save(path) writes it"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="800" title="report"></iframe>'


def report(
    *tables: Any,
    title: str | None = None,
    max_rows: int = report_job.MAX_ROWS,
    scene: SceneLike = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    **rows: Any,
) -> Report:
    """Return a page that shows measurements, flags, estimates, scores or bounds (tables or paths) in a browser.

    The arguments are those of ``nlosctl report``; ``rows`` are ``wide``, ``missing``, ``where``, ``declination_deg``,
    ``dimensions``, ``speed_m_s`` and standard deviations of `localize`. Raises DataError for faults of the data,
    UsageError for invalid options.
    """
    read = input_options(columns, None, scene, rows, kind=kind, crs=crs, origin=origin)
    for name in rows:
        raise UsageError(f"report takes no argument {name!r}; standard deviations are such as bearing_std_deg=2.0")
    inputs = [given for table in tables for given in inputs_of(table)]
    page, notes = report_job.report(inputs, read, OutputOptions(), title=title, max_rows=max_rows)
    return Report(html=page.decode("utf-8"), notes=tuple(notes))
