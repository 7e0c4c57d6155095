"""Figures: one style, files by extension, the same bytes twice, and a cure where matplotlib is missing."""

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
    """Return a figure with every kind of panel."""
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


@pytest.mark.parametrize(
    ("name", "start"), [("a.png", b"\x89PNG\r\n"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF-")], ids=PICTURE_FORMATS
)
def test_the_extension_tells_the_format(tmp_path: Path, name: str, start: bytes) -> None:
    """PNG, SVG and PDF are written by the extension of the name."""
    save_figure(gallery(), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("format", PICTURE_FORMATS)
def test_the_same_figure_is_the_same_bytes(format: str) -> None:
    """Two figures of the same content are equal byte by byte, whatever was saved before, and carry no date."""
    first, again = gallery(), gallery()
    expected = figure_bytes(first, format)
    for other in PICTURE_FORMATS:
        if other != format:
            figure_bytes(again, other)
    content = figure_bytes(again, format)
    assert content == expected
    assert not re.search(rb"CreationDate|<dc:date>|tIME", content)


def test_the_style_is_ours_alone() -> None:
    """Settings of the user change no byte of a picture, and ours do not leak into theirs."""
    import matplotlib as mpl

    expected = figure_bytes(gallery(), "png")
    before = dict(mpl.rcParams)
    with mpl.rc_context({"lines.linewidth": 7.0, "axes.facecolor": "red", "font.size": 20.0}):
        assert figure_bytes(gallery(), "png") == expected
    assert dict(mpl.rcParams) == before


def test_nothing_imports_pyplot() -> None:
    """Drawing touches no global figure and no window system: pyplot is not imported."""
    program = "import sys, nlosctl.plotting.maps, nlosctl.plotting.series; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("target", "format", "text"),
    [
        ("a.jpg", None, "got extension '.jpg', expected a picture's name that ends in one of .png, .svg, .pdf"),
        ("a.svgz", None, "did you mean 'svg'?"),
        ("a", None, "no extension"),
        ("-", "gif", "--format must be one of png, svg, pdf. Got 'gif'"),
    ],
)
def test_other_formats_are_refused(target: str, format: str | None, text: str) -> None:
    """Another extension or format is an error that names the three."""
    with pytest.raises(UsageError) as told:
        picture_format(target, format)
    assert text in str(told.value)


def test_a_picture_replaces_nothing_unless_told(tmp_path: Path) -> None:
    """A file that exists stays, unless overwriting is asked for."""
    target = tmp_path / "a.png"
    target.write_text("mine")
    figure, _ = new_figure()
    with pytest.raises(DataError, match="exists already"):
        save_figure(figure, target)
    assert target.read_text() == "mine"
    save_figure(figure, target, overwrite=True)
    assert target.read_bytes().startswith(b"\x89PNG")


def test_a_missing_matplotlib_is_told_with_its_cure() -> None:
    """Without matplotlib the message has the line that installs it; another missing module stays what it is."""
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
    """No two series share a line style or a marker."""
    assert len({look.line for look in SERIES_STYLES}) == len(SERIES_STYLES)
    assert len({look.marker for look in SERIES_STYLES}) == len(SERIES_STYLES)


def test_labels_carry_their_unit() -> None:
    """A label is a quantity with its unit, a dash for a pure number."""
    assert axis_label("RMSE", "m") == "RMSE [m]"
    assert axis_label("probability", "") == "probability [-]"


def test_a_cdf_counts_what_has_no_value() -> None:
    """Rows without a value keep the curve below 1."""
    figure, (axes,) = new_figure()
    draw_cdf(axes, {"a": np.array([1.0, np.nan, 2.0, np.inf])})
    y = np.asarray(axes.lines[0].get_ydata(), dtype=float)
    assert y.tolist() == [0.0, 0.25, 0.5]
    assert figure_bytes(figure, "png")


def test_panels_stand_empty_input() -> None:
    """Series without a value, values all alike and maps without one are drawn without a warning."""
    figure, panels = new_figure(2, 3)
    empty = np.empty(0)
    draw_series(panels[0], [Series(label="a", x=empty, y=empty)], log_y=True)
    draw_cdf(panels[1], {"a": np.array([np.nan])})
    draw_points(panels[3], [Series(label="a", x=empty, y=empty)])
    draw_map(panels[4], X, X, np.full((5, 5), np.nan), "RMSE [m]", log=True)
    draw_map(panels[5], X, X, np.full((5, 5), 3.0), "RMSE [m]")
    assert figure_bytes(figure, "svg")


def test_cells_reach_halfway_to_their_neighbours() -> None:
    """Edges lie in the middle between centres, and as far beyond the outer ones."""
    assert edges_of(np.array([0.0, 1.0, 3.0])).tolist() == [-0.5, 0.5, 2.0, 4.0]
    assert edges_of(np.array([2.0])).tolist() == [1.5, 2.5]


def test_a_region_map_names_the_regions_that_are_there() -> None:
    """The legend has the regions of the map, and none that does not appear."""
    _, (axes,) = new_figure()
    draw_regions(axes, X, X, np.repeat([[0, 0, 2, 2, -1]], 5, axis=0).astype(np.int64), ["a", "b", "c"])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["a", "c"]
    assert axes.get_aspect() == 1.0
