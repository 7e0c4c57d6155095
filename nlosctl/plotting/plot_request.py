"""The request for a picture, and the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from nlosctl.contract.run_options import InputOptions
from nlosctl.io.results.plot_inputs import PlotInput
from nlosctl.plotting.figures import new_figure
from nlosctl.plotting.library import Axes, Figure
from nlosctl.plotting.texts import plain_lines

__all__ = ["Picture", "PlotRequest"]

_CHARACTERS_PER_IN = 10


@dataclass(frozen=True, kw_only=True)
class PlotRequest:
    """The files and what to show of them; None: the default of the view.

    ``x`` and ``y`` name a sweep column and a figure, ``paths`` the triplets to draw; at most about ``max_rows`` rows
    are drawn. ``size_in`` is width and height in inches, ``target_z_m`` the height of the targets for slant ranges,
    ``by`` a carried column that colours estimates.
    """

    files: Sequence[PlotInput]
    read: InputOptions = field(default_factory=InputOptions)
    snapshot: str | None = None
    paths: Sequence[str] = ()
    target_z_m: float | None = None
    by: str | None = None
    x: str | None = None
    y: str | None = None
    linear: bool = False
    title: str | None = None
    size_in: tuple[float, float] | None = None
    max_rows: int = 1_000_000

    def of(self, *contents: str) -> list[PlotInput]:
        """Return the files with one of these ``contents``."""
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
        """Return a figure with the requested size and title; default: ``size_in`` and ``title``."""
        width, height = self.size_in or size_in
        words = title if self.title is None else self.title
        shown_title = None if words is None else plain_lines(words, int(_CHARACTERS_PER_IN * width))
        return new_figure(rows, columns, width_in=width, height_in=height, title=shown_title, width_ratios=width_ratios)


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure and notes on it, such as rows left out or snapshots thinned."""

    figure: Figure
    notes: Sequence[str] = ()
