"""Figures: style, file formats, reproducible bytes, missing matplotlib."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nlosctl.errors import DataError, UsageError
from nlosctl.plotting.figures import (
    PICTURE_FORMATS,
    SERIES_STYLES,
    axis_label,
    figure_bytes,
    new_figure,
    picture_format,
    save_figure,
)
from nlosctl.plotting.library import Figure
from nlosctl.plotting.maps import draw_map, draw_regions, edges_of
from nlosctl.plotting.panels import Series
from nlosctl.plotting.series import draw_cdf, draw_points, draw_reference_lines, draw_series

X = np.linspace(1.0, 3.0, 5)


def gallery() -> Figure:
    """Return a figure with a panel of every kind."""
    figure, panels = new_figure(2, 3, width_in=9.0, height_in=6.0, title="all of them")
    draw_series(panels[0], [Series(label=f"{k}", x=X, y=X + k, error=0.1 * X) for k in range(3)], log_x=True)
    draw_reference_lines(panels[0], {"a paper's": 2.0})
    draw_cdf(panels[1], {"a": X, "b": np.array([1.0, np.nan, 2.0, np.inf])})
    draw_series(panels[2], [Series(label="a", x=X, y=X, line=False)], log_y=True)
    draw_points(panels[3], [Series(label=f"{k}", x=X, y=X + k) for k in range(8)])
    x, y = np.linspace(-2.0, 2.0, 9), np.linspace(-1.0, 1.0, 7)
    grid = np.hypot(*np.meshgrid(x, y)) + 0.1
    draw_regions(panels[4], x, y, (grid > 1.0).astype(np.int64) - (grid > 2.0), ["near", "far", "nowhere"])
    draw_map(panels[5], x, y, grid, "distance [m]", log=True)
    return figure


@pytest.mark.extensive
@pytest.mark.parametrize(
    ("name", "start"), [("a.png", b"\x89PNG\r\n"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF-")], ids=PICTURE_FORMATS
)
def test_the_extension_selects_the_format(tmp_path: Path, name: str, start: bytes) -> None:
    """PNG, SVG and PDF are selected by the extension."""
    save_figure(gallery(), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.extensive
@pytest.mark.parametrize("format", PICTURE_FORMATS)
def test_figures_are_reproducible(format: str) -> None:
    """Equal content gives equal bytes, without a date, whatever was saved before."""
    first, again = gallery(), gallery()
    expected = figure_bytes(first, format)
    for other in PICTURE_FORMATS:
        if other != format:
            figure_bytes(again, other)
    content = figure_bytes(again, format)
    assert content == expected
    assert not re.search(rb"CreationDate|<dc:date>|tIME", content)


@pytest.mark.extensive
def test_styles_do_not_interfere() -> None:
    """The user's settings change no byte of a figure, and ours do not change the user's."""
    import matplotlib as mpl

    expected = figure_bytes(gallery(), "png")
    before = dict(mpl.rcParams)
    with mpl.rc_context({"lines.linewidth": 7.0, "axes.facecolor": "red", "font.size": 20.0}):
        assert figure_bytes(gallery(), "png") == expected
    assert dict(mpl.rcParams) == before


@pytest.mark.process
def test_pyplot_is_not_imported() -> None:
    """Plotting uses no global figure and no window system."""
    program = "import sys, nlosctl.plotting.maps, nlosctl.plotting.series; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("target", "format", "text"),
    [
        ("a.jpg", None, "got extension '.jpg', expected a picture's name that ends in one of .png, .svg, .pdf"),
        ("a.svgz", None, "did you mean 'svg'?"),
        ("a", None, "no extension"),
        ("-", "gif", "`format` must be one of png, svg, pdf. Got 'gif'"),
    ],
)
def test_other_formats_are_refused(target: str, format: str | None, text: str) -> None:
    """Another extension or format is an error that lists the three."""
    with pytest.raises(UsageError) as raised:
        picture_format(target, format)
    assert text in str(raised.value)


def test_figures_are_not_overwritten(tmp_path: Path) -> None:
    """An existing file is kept unless overwriting is requested."""
    target = tmp_path / "a.png"
    target.write_text("mine")
    figure, _ = new_figure()
    with pytest.raises(DataError, match="exists already"):
        save_figure(figure, target)
    assert target.read_text() == "mine"
    save_figure(figure, target, overwrite=True)
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.process
def test_a_missing_matplotlib_is_reported() -> None:
    """The message has the command that installs it; another missing module is reported as itself."""
    program = (
        "import sys; sys.modules[{!r}] = None\n"
        "try:\n    import nlosctl.plotting.figures\n"
        "except Exception as error:\n    print(type(error).__name__, error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program.format("matplotlib")], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("MissingExtraError drawing needs matplotlib, which is not installed")
    assert "pip install 'nlosctl[plot]'" in done.stdout
    done = subprocess.run([sys.executable, "-c", program.format("PIL")], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("ModuleNotFoundError")


def test_series_differ_without_colour() -> None:
    """No two series share line style or marker."""
    assert len({look.line for look in SERIES_STYLES}) == len(SERIES_STYLES)
    assert len({look.marker for look in SERIES_STYLES}) == len(SERIES_STYLES)


def test_labels_carry_their_unit() -> None:
    """A label is a quantity with its unit, a dash for a pure number."""
    assert axis_label("RMSE", "m") == "RMSE [m]"
    assert axis_label("probability", "") == "probability [-]"


def test_a_cdf_counts_missing_values() -> None:
    """Rows without a value keep the curve below 1."""
    figure, (axes,) = new_figure()
    draw_cdf(axes, {"a": np.array([1.0, np.nan, 2.0, np.inf])})
    y = np.asarray(axes.lines[0].get_ydata(), dtype=float)
    assert y.tolist() == [0.0, 0.25, 0.5]
    assert figure_bytes(figure, "png")


def test_panels_accept_empty_input() -> None:
    """Series without values, equal values and empty maps are plotted without a warning."""
    figure, panels = new_figure(2, 3)
    empty = np.empty(0)
    draw_series(panels[0], [Series(label="a", x=empty, y=empty)], log_y=True)
    draw_cdf(panels[1], {"a": np.array([np.nan])})
    draw_points(panels[3], [Series(label="a", x=empty, y=empty)])
    draw_map(panels[4], X, X, np.full((5, 5), np.nan), "RMSE [m]", log=True)
    draw_map(panels[5], X, X, np.full((5, 5), 3.0), "RMSE [m]")
    assert figure_bytes(figure, "svg")


def test_cells_reach_halfway_to_their_neighbours() -> None:
    """Edges are midway between centres, and as far beyond the outer ones."""
    assert edges_of(np.array([0.0, 1.0, 3.0])).tolist() == [-0.5, 0.5, 2.0, 4.0]
    assert edges_of(np.array([2.0])).tolist() == [1.5, 2.5]


def test_a_region_map_names_the_regions_that_are_there() -> None:
    """The legend lists the regions in the map and no others."""
    _, (axes,) = new_figure()
    draw_regions(axes, X, X, np.repeat([[0, 0, 2, 2, -1]], 5, axis=0).astype(np.int64), ["a", "b", "c"])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["a", "c"]
    assert axes.get_aspect() == 1.0
