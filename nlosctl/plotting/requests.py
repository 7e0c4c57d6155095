"""What a picture is asked to show, and what it came to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from nlosctl.io.measurements.options import ReadOptions
from nlosctl.io.results.plot_inputs import DrawnFile
from nlosctl.plotting.figures import new_figure
from nlosctl.plotting.library import Axes, Figure

__all__ = ["Picture", "Request"]


@dataclass(frozen=True, kw_only=True)
class Request:
    """The files, and what is to be seen of them; None: whatever suits.

    ``x`` and ``y`` name a sweep column and a figure, ``paths`` the triplets to draw; at most about ``max_rows`` rows
    are drawn. ``size_in`` is width and height in inches.
    """

    files: Sequence[DrawnFile]
    read: ReadOptions = field(default_factory=ReadOptions)
    snapshot: str | None = None
    paths: Sequence[str] = ()
    x: str | None = None
    y: str | None = None
    linear: bool = False
    title: str | None = None
    size_in: tuple[float, float] | None = None
    max_rows: int = 1_000_000

    def of(self, *contents: str) -> list[DrawnFile]:
        """Return the files that hold one of ``contents``."""
        return [file for file in self.files if file.content in contents]

    def figure(
        self,
        rows: int = 1,
        columns: int = 1,
        *,
        size_in: tuple[float, float] = (6.4, 4.4),
        title: str | None = None,
        width_ratios: Sequence[float] | None = None,
    ) -> tuple[Figure, list[Axes]]:
        """Return a figure of the size and with the title that are asked for, else of ``size_in`` and ``title``."""
        width, height = self.size_in or size_in
        told = title if self.title is None else self.title
        return new_figure(rows, columns, width_in=width, height_in=height, title=told, width_ratios=width_ratios)


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure, and what is to be said of it beside it: rows left out, snapshots thinned."""

    figure: Figure
    notes: Sequence[str] = ()
