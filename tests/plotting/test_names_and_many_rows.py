"""Text of the user in pictures, snapshots of many rows, slant ranges, places on the earth, many series."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any
from xml.dom import minidom

import numpy as np
import pyproj
import pytest

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import LineReflector
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.results.plot_inputs import PlotInput, open_plot_input
from nlosctl.models.traced_rays import ray_paths
from nlosctl.plotting.figures import figure_bytes, series_style, styles_by_part
from nlosctl.plotting.library import Circle, Figure, LineCollection
from nlosctl.plotting.plane import Extent
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.pictures import draw_picture

EVIL = ("$$", "$5 and $6", "\\evil{$", "a\x1b[31mb", "北京", "🦊 fox", "_hidden", "x" * 300, "a\nb", "\ud7ff<&>")


def opened(path: Path, *lines: str) -> PlotInput:
    """Return a file of these lines."""
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    (source,) = expand_inputs([str(path)])
    return open_plot_input(source, InputOptions())


def drawn(view: str, *files: PlotInput, **options: Any) -> Picture:
    """Return the picture of a view."""
    read = options.pop("read", InputOptions())
    return draw_picture(PlotRequest(files=files, read=read, **options), view)


def texts_of(figure: Figure) -> list[str]:
    """Return all texts as they are shown."""
    content = [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]
    return [text.replace("\\$", "$") for text in content]


@pytest.mark.parametrize("name", EVIL)
def test_names_appear_as_they_are_in_every_format(name: str, tmp_path: Path) -> None:
    """Dollars, control characters and characters that the font lacks: no error, no warning, an XML that parses."""
    quoted = '"' + name.replace('"', '""') + '"'
    file = opened(
        tmp_path / "b.csv",
        "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg",
        f"{quoted},{quoted},0,0,45,3",
        f"{quoted},b,100,0,135,3",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for title in (None, name):
            figure = drawn("scene", file, title=title).figure
            for format in ("png", "svg", "pdf"):
                content = figure_bytes(figure, format)
                if format == "svg":
                    minidom.parse(io.BytesIO(content))  # noqa: S318 - our own picture
    shown = plain(name)
    assert shown.replace("\\$", "$") in texts_of(figure)
    width = figure.axes[0].get_window_extent().width
    assert width > 100.0


def test_plain_text_is_unchanged() -> None:
    """Letters, umlauts and underscores inside are shown as they are; only what can't be shown is replaced."""
    assert plain("Zürich_2 (α)") == "Zürich_2 (α)"
    assert plain("$5") == "\\$5"
    assert plain("_x") == " _x"
    assert plain("\x1b北🦊") == "\\x1b\\u5317\\U01f98a"
    assert len(plain("x" * 300)) <= 49


def test_rays_go_through_their_bearing_and_mirror() -> None:
    """A ray's end is along its bearing; by the mirror y = 10 its last leg is mirrored, through a hit on the mirror."""
    goal = Extent()
    goal.include(np.array([[0.0, 0.0], [100.0, 50.0]]))
    sensor, bearing = np.array([[0.0, 0.0], [10.0, 0.0]]), np.radians([30.0, 120.0])
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    direct = ray_paths(sensor, bearing, None, goal.low, goal.high)
    leg = direct[:, 2] - direct[:, 1]
    np.testing.assert_allclose(leg / np.hypot(*leg.T)[:, None], along, atol=1e-12)
    np.testing.assert_array_equal(direct[:, 1], sensor)
    mirrored = ray_paths(
        sensor, bearing, LineReflector(name="m", point=(0.0, 10.0), direction=(1.0, 0.0)), goal.low, goal.high
    )
    np.testing.assert_allclose(mirrored[:, 1, 1], 10.0)
    leg = mirrored[:, 2] - mirrored[:, 1]
    np.testing.assert_allclose(leg / np.hypot(*leg.T)[:, None], along * (1.0, -1.0), atol=1e-12)


def test_thousands_of_bearings_are_a_few_faint_collections(tmp_path: Path) -> None:
    """2400 rows of a moving sensor: every ray is drawn, in one faint collection for each kind, and one track."""
    turn = np.linspace(0.0, 6.0, 2400)
    rows = (
        f"0,car,{500 * np.cos(t)},{500 * np.sin(t)},{np.degrees(np.arctan2(-np.sin(t), -np.cos(t)))},5,{k % 4 > 0}"
        for k, t in enumerate(turn)
    )
    file = opened(tmp_path / "f.csv", "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,los", *rows)
    figure = drawn("scene", file).figure
    (axes,) = figure.axes
    collections = [part for part in axes.collections if isinstance(part, LineCollection)]
    sizes = sorted(len(part.get_segments()) for part in collections)
    assert sizes == [1, 600, 1800]
    assert all(part.get_alpha() <= 0.05 for part in collections if len(part.get_segments()) > 1)
    assert len(axes.get_children()) < 60
    track = next(part for part in collections if len(part.get_segments()) == 1).get_segments()[0]
    np.testing.assert_allclose(track, 500.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1))


SLANT = (
    "snapshot,sensor,sensor_x_m,sensor_y_m,sensor_z_m,range_m,range_std_m",
    "1,A1,0,0,4,5,0.05",
    "1,A2,10,0,4,13,0.05",
    "1,A3,10,8,14,12,0.05",
)


def test_slant_ranges_have_the_horizontal_radius(tmp_path: Path) -> None:
    """With the height of the targets a circle is sqrt(range^2 - height^2); a range below the height has no circle."""
    file = opened(tmp_path / "r.csv", *SLANT)
    flat, at_one = drawn("scene", file), drawn("scene", file, target_z_m=1.0)
    radii = [
        sorted(round(part.radius, 9) for part in picture.figure.axes[0].patches if isinstance(part, Circle))
        for picture in (flat, at_one)
    ]
    assert radii[0] == [5.0, 12.0, 13.0]
    assert radii[1] == [4.0, round(float(np.sqrt(160.0)), 9)]
    assert any("target_z_m" in note for note in flat.notes)
    assert any("1 of 3 ranges" in note for note in at_one.notes)
    without = opened(tmp_path / "n.csv", "snapshot,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m", "1,a,0,0,5,1")
    with pytest.raises(UsageError, match="sensor_z_m"):
        drawn("scene", without, target_z_m=1.0)


def test_places_on_the_earth_have_degrees_at_the_ticks(tmp_path: Path) -> None:
    """Ticks are where pyproj has the longitude along the lower edge and the latitude along the left one."""
    file = opened(
        tmp_path / "e.csv",
        "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,azimuth_deg,bearing_std_deg",
        "1,hill,47.37,8.54,110,1",
        "1,hill#2,47.37,8.54,111,1",
        "1,tower,-47.4 ,8.6,198,1".replace("-47.4 ", "47.4"),
    )
    figure = drawn("scene", file, read=InputOptions(crs="EPSG:32632")).figure
    axes = figure.axes[0]
    figure.draw_without_rendering()
    to_earth = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
    for where, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True):
        degrees = float(label.get_text().removesuffix("° E"))
        assert to_earth.transform(where, bottom)[0] == pytest.approx(degrees, abs=1e-5)
    for where, label in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True):
        degrees = float(label.get_text().removesuffix("° N"))
        assert to_earth.transform(left, where)[1] == pytest.approx(degrees, abs=1e-5)
    assert {"N", "hill, hill#2", "tower"} <= set(texts_of(figure))


def test_many_series_look_different() -> None:
    """At least 24 series differ; of more than eight of a grid, one method has one colour, one value one line."""
    looks = [series_style(number) for number in range(64)]
    assert len({(look.color, look.line, look.marker, look.filled) for look in looks}) == 64
    parts = [(method, value) for method in ("ls", "ml", "stansfield") for value in "abcd"]
    styles = dict(zip(parts, styles_by_part(parts), strict=True))
    assert len({(look.color, look.line) for look in styles.values()}) == 12
    for method, value in parts:
        assert styles[method, value].color == styles[method, "a"].color
        assert styles[method, value].line == styles["ls", value].line


def test_estimates_by_a_carried_column_are_tracks_in_time(tmp_path: Path) -> None:
    """With ``by`` each value has its own line, through its fixes in the order of time."""
    file = opened(
        tmp_path / "e.csv",
        "snapshot,method,target,alternative,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,n_measurements,n_used,cost,status,"
        "animal,time_s",
        *(f"{k},ml,0,0,{k},{k % 2},1,0,1,3,3,0,ok,{'ab'[k % 2]},{9 - k}" for k in range(6)),
    )
    axes = drawn("estimates", file, by="animal").figure.axes[0]
    tracks = {str(line.get_label()): line.get_xdata() for line in axes.lines}
    np.testing.assert_array_equal(tracks["a"], [4.0, 2.0, 0.0])
    np.testing.assert_array_equal(tracks["b"], [5.0, 3.0, 1.0])
    with pytest.raises(UsageError, match="no column 'tag'"):
        drawn("estimates", file, by="tag")


def test_efficiency_is_the_rmse_over_the_bound(tmp_path: Path) -> None:
    """Against a sweep the line is RMSE / bound; without a file of bounds it is a usage error."""
    scores = opened(tmp_path / "s.csv", "of,method,rows,rmse_m,sweep_k", "estimates,ml,9,6,1", "estimates,ml,9,20,2")
    bound = opened(
        tmp_path / "b.csv",
        "snapshot,x_m,y_m,bound_xx_m2,bound_xy_m2,bound_yy_m2,rms_m,semi_major_m,semi_minor_m,orientation_rad,cep50_m,n_used,sweep_k",
        "0,0,0,1,1,1,3,1,1,1,1,1,1",
        "1,0,0,1,1,1,4,1,1,1,1,1,2",
    )
    axes = drawn("sweep", scores, bound, y="efficiency").figure.axes[0]
    line = next(container.lines[0] for container in axes.containers)
    np.testing.assert_allclose(line.get_ydata(), [2.0, 5.0])
    with pytest.raises(UsageError, match="bound"):
        drawn("sweep", scores, y="efficiency")
