"""Figures of users' files: choice of view and content."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

import nlosctl
from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError, UsageError
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.results.plot_inputs import PlotInput, open_plot_input, read_sampled
from nlosctl.plotting.catalogue import VIEWS
from nlosctl.plotting.figures import figure_bytes
from nlosctl.plotting.library import Axes, Circle, Ellipse, Figure
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.suitable_views import suitable_views
from nlosctl.plotting.views.pictures import choose_view, draw_picture

pytestmark = pytest.mark.extensive

FIXTURES = Path(__file__).parents[2] / "fixtures"
SWEEP = {"bearing_std_deg": [0.2, 1.0, 5.0]}


@cache
def made(name: str) -> pa.Table:
    """Return a small table of every kind, made once."""
    if name == "bearings":
        return nlosctl.simulate("song-flat", trials=30)
    if name == "walls":
        return nlosctl.simulate("madhow-walls", trials=20, source="D")
    if name == "horizon":
        return nlosctl.simulate("over-the-horizon", trials=5)
    if name == "swept":
        return nlosctl.simulate("ring", trials=60, sweep=SWEEP)
    if name == "paths":
        return nlosctl.simulate("shen", trials=80)
    if name == "track":
        walks = nlosctl.simulate("walk", trials=60, states=30)
        return nlosctl.track(walks, by="walk", acceleration_psd=0.05).estimates
    if name == "echoes":
        return nlosctl.simulate("liang", trials=3)
    if name.startswith("fixes of "):
        return nlosctl.localize(made(name.removeprefix("fixes of ")), method=["ml", "stansfield"]).estimates
    if name == "fixes in walls":
        return nlosctl.localize(made("walls"), method="mixture-ml").estimates
    if name == "flags in walls":
        return nlosctl.localize(made("walls"), method="mixture-ml", least_evidence=-1000.0).flags
    if name == "flags with outliers":
        return nlosctl.localize(
            nlosctl.simulate("madhow-ring", trials=300, nlos_receivers=2), method="mixture-ml", least_evidence=-1000.0
        ).flags
    if name == "flags of paths":
        return nlosctl.detect_ip(made("paths"), method=["chi2", "tdaj"]).flags
    if name == "flags by chi2":
        return nlosctl.detect_ip(made("paths"), method="chi2").flags
    if name == "targets by chi2":
        return nlosctl.detect_ip(made("paths"), method="chi2").estimates
    if name == "flags of echoes":
        return nlosctl.identify_los(made("echoes")).flags
    if name == "targets":
        return nlosctl.identify_los(made("echoes")).estimates
    if name == "map":
        return nlosctl.bound(made("bearings"), map=(-2000.0, 4000.0, -2000.0, 3000.0, 250.0))
    assert name == "bounds"
    return nlosctl.bound(made("swept"))


@pytest.fixture
def files(tmp_path: Path) -> Any:
    """Write tables by name and open them."""

    def write(*names: str) -> list[PlotInput]:
        paths = [tmp_path / f"{name}.parquet" for name in names]
        for name, path in zip(names, paths, strict=True):
            pyarrow.parquet.write_table(made(name), path)
        return [open_plot_input(given, InputOptions()) for given in expand_inputs([str(path) for path in paths])]

    return write


def picture(files: Sequence[PlotInput], view: str | None = None, **wanted: Any) -> Picture:
    """Return the figure of a view."""
    return draw_picture(PlotRequest(files=files, **wanted), choose_view(files, view))


def ellipses(axes: Axes) -> list[Ellipse]:
    """Return the ellipses of a panel, without circles."""
    return [patch for patch in axes.patches if isinstance(patch, Ellipse) and not isinstance(patch, Circle)]


def inside(axes: Axes, ellipse: Ellipse) -> bool:
    """Whether an ellipse is within the limits of its panel."""
    box = ellipse.get_path().transformed(ellipse.get_patch_transform()).get_extents()
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    return bool(left <= box.x0 and box.x1 <= right and low <= box.y0 and box.y1 <= high)


def shown(figure: Figure) -> list[Axes]:
    """Return the visible panels without colour bars."""
    return [axes for axes in figure.axes if axes.get_visible()]


def legend_words(axes: Axes) -> list[str]:
    """Return the texts of a panel's legend."""
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


CASES = [
    (["bearings"], "scene"),
    (["bearings", "fixes of bearings"], "scene"),
    (["horizon", "fixes of horizon"], "scene"),
    (["flags in walls", "fixes in walls"], "scene"),
    (["fixes of bearings"], "estimates"),
    (["track"], "tracks"),
    (["fixes of swept"], "sweep"),
    (["fixes of swept", "bounds"], "sweep"),
    (["flags of paths"], "roc"),
    (["paths"], "triplets"),
    (["flags by chi2", "targets by chi2"], "triplets"),
    (["flags of echoes"], "echoes"),
    (["flags of echoes", "targets"], "echoes"),
    (["map"], "map"),
]


@pytest.mark.parametrize(
    ("names", "view"), CASES, ids=lambda value: "+".join(value) if isinstance(value, list) else value
)
def test_columns_select_the_view(files: Any, names: list[str], view: str) -> None:
    """By default the columns of the files select the view; all axes have units."""
    opened = files(*names)
    assert choose_view(opened, None) == view
    figure = picture(opened).figure
    for axes in shown(figure):
        assert axes.has_data()
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith("]"), label
    content = figure_bytes(figure, "png")
    assert content == figure_bytes(picture(opened).figure, "png")


@pytest.mark.parametrize("view", [view for view in VIEWS if view not in ("calibration", "posterior")])
def test_every_view_can_be_plotted(files: Any, view: str) -> None:
    """Each view of the catalogue is plotted for some files; calibrations and maps have tests of their own.

    Those are in `test_calibration_view` and `test_cli_posterior_files`.
    """
    names = {"cdf": ["fixes of bearings"]}.get(view) or next(names for names, chosen in CASES if chosen == view)
    assert figure_bytes(picture(files(*names), view).figure, "svg").startswith(b"<?xml")


@pytest.mark.parametrize("names", [["bearings", "fixes of bearings"], ["horizon", "fixes of horizon"]])
def test_the_ellipses_of_a_snapshot_are_all_in_view(files: Any, names: list[str]) -> None:
    """Every estimate with a covariance has its 95 % ellipse within every panel, at equal scales."""
    figure = picture(files(*names)).figure
    estimates = made(names[1]).filter(pa.compute.equal(made(names[1]).column("snapshot"), 0))
    covariances = len(estimates) - estimates.column("cov_xx_m2").null_count
    for axes in shown(figure):
        assert len(ellipses(axes)) == covariances
        assert all(inside(axes, ellipse) for ellipse in ellipses(axes))
        assert axes.get_aspect() == 1.0


def test_ellipses_cover_95_percent(files: Any) -> None:
    """The semi-axes are sqrt(5.991) standard deviations along the principal axes."""
    axes = shown(picture(files("bearings", "fixes of bearings")).figure)[0]
    row = made("fixes of bearings").slice(0, 1).to_pylist()[0]
    matrix = np.array([[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]])
    values, vectors = np.linalg.eigh(matrix)
    ellipse = ellipses(axes)[0]
    assert ellipse.width == pytest.approx(2.0 * np.sqrt(5.991465 * values[1]), rel=1e-6)
    assert ellipse.height == pytest.approx(2.0 * np.sqrt(5.991465 * values[0]), rel=1e-6)
    along = np.array([np.cos(np.radians(ellipse.angle)), np.sin(np.radians(ellipse.angle))])
    assert abs(along @ vectors[:, 1]) == pytest.approx(1.0)


def test_nlos_rows_have_their_own_style(files: Any) -> None:
    """Rows with los false have a style of their own and no wedge; direct rows have a wedge each."""
    opened = files("flags in walls", "fixes in walls")
    axes = shown(picture(opened).figure)[0]
    flags = made("flags in walls").filter(pa.compute.equal(made("flags in walls").column("snapshot"), 0)).to_pylist()
    flagged = sum(row["los"] is False for row in flags)
    wedges = [patch for patch in axes.patches if type(patch).__name__ == "Polygon"]
    assert 0 < flagged < len(flags)
    assert len(wedges) == len(flags) - flagged
    assert "bearing, flagged (los false)" in legend_words(shown(picture(opened).figure)[-1])


def test_reflected_rays_go_by_their_mirror(files: Any) -> None:
    """A reflected ray has three vertices, the middle one on its mirror; the truth is near its second leg."""
    axes = shown(picture(files("bearings")).figure)[0]
    ways = [line for line in axes.lines if line.get_linestyle() != "None"]
    rays = [np.column_stack(line.get_data()) for line in ways if len(line.get_xdata()) == 3]
    assert len(rays) == 3
    target = np.array([10e3, 5e3])
    for ray in rays:
        leg, way = ray[2] - ray[1], target - ray[1]
        along = leg / np.hypot(*leg)
        assert abs(along[0] * way[1] - along[1] * way[0]) < 1500.0
        assert np.hypot(*leg) > along @ way > 0.0


def test_the_three_points_of_a_path(files: Any) -> None:
    """Points 2 and 3 are on the path's ellipse: their distances to both stations sum to its length."""
    row = next(row for row in made("paths").to_pylist() if row["path_length_m"] > 10.0)
    axes = shown(picture(files("flags by chi2"), "triplets", snapshot=str(row["snapshot"])).figure)[0]
    markers = {
        line.get_marker(): np.column_stack(line.get_data())[0] for line in axes.lines if len(line.get_xdata()) == 1
    }
    for marker in ("v", "<"):
        legs = [np.hypot(*(markers[marker] - [row[f"{node}_x_m"], row[f"{node}_y_m"]])) for node in ("tx", "rx")]
        assert sum(legs) == pytest.approx(row["path_length_m"])
    along = np.array([np.cos(row["dod_rad"]), np.sin(row["dod_rad"])])
    way = markers["o"] - [row["tx_x_m"], row["tx_y_m"]]
    assert along[0] * way[1] - along[1] * way[0] == pytest.approx(0.0, abs=1e-9)


def test_each_echo_is_a_circle(files: Any) -> None:
    """Every range of the snapshot is a circle about its sensor; the legend names targets and others."""
    axes = shown(picture(files("flags of echoes", "targets")).figure)[0]
    flags = made("flags of echoes").filter(pa.compute.equal(made("flags of echoes").column("snapshot"), 0)).to_pylist()
    radii = sorted(patch.radius for patch in axes.patches if isinstance(patch, Circle))
    assert radii == pytest.approx(sorted(row["range_m"] for row in flags))
    labels = {f"echo of target {row['target']}" for row in flags if row["los"]}
    assert labels <= set(legend_words(axes))


def test_a_sweep_has_a_line_per_method(files: Any) -> None:
    """A line per method through the RMSE at each value, with standard errors and the bound below."""
    axes = shown(picture(files("fixes of swept", "bounds")).figure)[0]
    assert set(legend_words(axes)) == {"ml", "stansfield", "Cramér-Rao bound"}
    groups = nlosctl.evaluate(made("fixes of swept")).groups
    lines = {container.get_label(): container for container in axes.containers}
    for method in ("ml", "stansfield"):
        mine = [group for group in groups if group["method"] == method]
        assert np.asarray(lines[method][0].get_xdata()).tolist() == SWEEP["bearing_std_deg"]
        assert np.asarray(lines[method][0].get_ydata()).tolist() == [group["rmse_m"] for group in mine]
        bars = lines[method][2][0].get_segments()
        half = [0.5 * (bar[1][1] - bar[0][1]) for bar in bars]
        assert half == pytest.approx([group["rmse_std_error_m"] for group in mine])
    bound = next(line for line in axes.lines if line.get_label() == "Cramér-Rao bound")
    square = np.asarray(made("bounds").column("rms_m")).reshape(3, -1) ** 2
    assert np.asarray(bound.get_ydata()).tolist() == pytest.approx(np.sqrt(square.mean(axis=1)))


def test_scores_draw_the_same_line_as_their_estimates(files: Any, tmp_path: Path) -> None:
    """The CSV output of ``evaluate`` gives the figure that its estimates give."""
    from nlosctl.cli.main import run

    opened = files("fixes of swept")
    scores = tmp_path / "scores.csv"
    assert run(["evaluate", opened[0].name, "-o", str(scores)]) == 0
    by_scores = picture([open_plot_input(expand_inputs([str(scores)])[0], InputOptions())])
    assert figure_bytes(by_scores.figure, "png") == figure_bytes(picture(opened).figure, "png")


def test_methods_without_a_sweep_are_horizontal_lines(tmp_path: Path) -> None:
    """A method that was not swept is a horizontal line with its name."""
    fixes = nlosctl.localize(
        made("bearings"), method=["ls", "ml"], sweep={"ml:min_range_m": [0.0, 10.0, 50.0]}
    ).estimates
    pyarrow.parquet.write_table(fixes, tmp_path / "e.parquet")
    axes = shown(picture([open_plot_input(expand_inputs([str(tmp_path / "e.parquet")])[0], InputOptions())]).figure)[0]
    assert "ls" in [text.get_text() for text in axes.texts]
    assert axes.get_xlabel() == "min range [m]"


def test_detection_rates_against_a_sweep(tmp_path: Path) -> None:
    """P_d of swept detectors has binomial error bars; --y selects another metric, --x another sweep."""
    flags = nlosctl.detect_ip(
        made("paths"), method="tdaj", sweep={"eta_m": [0.0, 2.0], "false_alarm": [0.01, 0.1, 0.3]}
    ).flags
    pyarrow.parquet.write_table(flags, tmp_path / "f.parquet")
    opened = [open_plot_input(expand_inputs([str(tmp_path / "f.parquet")])[0], InputOptions())]
    axes = shown(picture(opened).figure)[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("false alarm [-]", "$P_d$ [-]")
    group = nlosctl.evaluate(flags).groups[0]
    count = group["indirect_called_direct"] + group["indirect_called_indirect"]
    bar = axes.containers[0][2][0].get_segments()[0]
    assert bar[1][1] - bar[0][1] == pytest.approx(2.0 * np.sqrt(group["p_d"] * (1.0 - group["p_d"]) / count))
    other = shown(picture(opened, y="p_fa", x="eta_m").figure)[0]
    assert (other.get_xlabel(), other.get_ylabel()) == ("eta [m]", "$P_{fa}$ [-]")
    for wanted, text in (({"y": "p_df"}, "did you mean 'p_d'"), ({"x": "eta"}, "did you mean 'eta_m'")):
        with pytest.raises(UsageError, match=text):
            picture(opened, **wanted)


def test_a_curve_per_detector(files: Any) -> None:
    """The ROC has each detector's curve, and the point of its flags on the curve."""
    left, right = shown(picture(files("flags of paths")).figure)
    groups = {group["method"]: group for group in nlosctl.evaluate(made("flags of paths")).groups}
    for method, group in groups.items():
        point = next(line for line in left.lines if line.get_label() == f"{method} as flagged")
        assert [float(v[0]) for v in point.get_data()] == pytest.approx([group["p_fa"], group["p_d"]])
        curve = next(line for line in left.lines if str(line.get_label()) == f"{method}: AUC {group['auc']:.3f}")
        x, y = (np.asarray(values) for values in curve.get_data())
        assert np.min(np.hypot(x - group["p_fa"], y - group["p_d"])) < 1e-9
    assert len(legend_words(right)) == 2


def test_calibration_of_line_of_sight_flags(files: Any) -> None:
    """Line-of-sight flags: the point is at P_fa and P_d; the fractions of ten bins are on the diagonal."""
    left, right = shown(picture(files("flags with outliers"), "roc").figure)
    table = made("flags with outliers")
    flags = table.filter(pa.compute.is_valid(table.column("los"))).to_pydict()
    called, truth, stated = (np.array(flags[name]) for name in ("los", "truth_los", "los_probability"))
    point = next(line for line in left.lines if "flagged" in str(line.get_label()))
    assert [float(v[0]) for v in point.get_data()] == pytest.approx([called[~truth].mean(), called[truth].mean()])
    low, high = [(stated >= step / 10) & (stated < step / 10 + 0.1 + (step == 9)) for step in (0, 9)]
    x, y = (np.asarray(values) for values in right.lines[1].get_data())
    for place, inside in ((0, low), (-1, high)):
        assert (x[place], y[place]) == pytest.approx((stated[inside].mean(), truth[inside].mean()))
        assert abs(x[place] - y[place]) < 0.05


def test_a_distribution_counts_every_row(files: Any) -> None:
    """The CDF of a method steps at the errors of its rows with truth."""
    axes = shown(picture(files("fixes of bearings"), "cdf").figure)[0]
    rows = [row for row in made("fixes of bearings").to_pylist() if row["method"] == "ml"]
    errors = sorted(float(np.hypot(row["x_m"] - row["truth_x_m"], row["y_m"] - row["truth_y_m"])) for row in rows)
    assert np.asarray(axes.lines[0].get_xdata())[1:].tolist() == pytest.approx(errors)


def test_a_map_shows_its_grid(files: Any) -> None:
    """Every vertex of the bound map is a cell of the figure, with its value."""
    axes = picture(files("map")).figure.axes[0]
    values = np.ma.MaskedArray(axes.collections[0].get_array()).filled(np.nan).ravel()
    expected = np.array([np.nan if v is None else v for v in made("map").column("rms_m").to_pylist()])
    np.testing.assert_array_equal(values, expected)


def test_many_estimates_become_a_density(tmp_path: Path) -> None:
    """Above some thousand estimates a panel shows counts per cell, and all points are counted."""
    fixes = nlosctl.localize(nlosctl.simulate("ring", trials=4000), method="ls").estimates
    pyarrow.parquet.write_table(fixes, tmp_path / "e.parquet")
    axes = picture([open_plot_input(expand_inputs([str(tmp_path / "e.parquet")])[0], InputOptions())]).figure.axes[0]
    counts = np.ma.MaskedArray(axes.collections[0].get_array()).filled(0.0)
    assert 3900 < counts.sum() <= 4000


def test_large_files_are_thinned_by_whole_snapshots(files: Any) -> None:
    """Above the limit evenly spaced snapshots are plotted with the rows of all methods, and a note states it."""
    file = files("fixes of swept")[0]
    rows = read_sampled(file, ("snapshot", "method"), 50)
    assert (rows.total, rows.step) == (360, 8)
    kept, count = np.unique(rows.columns["snapshot"], return_counts=True)
    assert 18 <= kept.size <= 25
    assert set(count.tolist()) == {2}
    assert set(rows.columns["method"]) == {"ml", "stansfield"}
    assert all(np.unique(kept % period).size >= 0.75 * min(period, kept.size) for period in (2, 3, 4, 5, 8, 16, 20))
    plotted = picture([file], "cdf", max_rows=50)
    assert any("1 of 8 snapshots is drawn" in note for note in plotted.notes)
    assert "1 of 8 snapshots is drawn" in plotted.figure.get_supxlabel().replace("\n", " ")


def test_unsuitable_views_are_refused(files: Any) -> None:
    """The error of an unsuitable view lists its requirements and suitable views; unknown views too."""
    opened = files("fixes of bearings")
    with pytest.raises(
        UsageError, match=r"`view` map takes a map of 'bound --map'.*suitable views: estimates, cdf, scene"
    ):
        choose_view(opened, "map")
    with pytest.raises(UsageError, match=r"no view 'scenes' \(did you mean 'scene'\?\)"):
        choose_view(opened, "scenes")
    assert suitable_views(opened, one_snapshot=True)[0] == "scene"
    with pytest.raises(UsageError, match="no view suits"):
        choose_view(files("map", "paths"), None)


def test_unknown_snapshots_are_refused(files: Any) -> None:
    """A missing snapshot is an error that names the file."""
    for names in (["bearings"], ["fixes of bearings"]):
        opened = files(*names)
        with pytest.raises(DataError, match="no snapshot '999'"):
            picture(opened, "scene", snapshot="999")


@pytest.mark.parametrize(
    "name", ["bearings.csv", "ranges.csv", "triplets.csv", "over_the_horizon.csv", "echoes.csv", "reflected_ranges.csv"]
)
def test_every_good_fixture_can_be_plotted(name: str) -> None:
    """Fixtures of every kind are plotted in their columns and units."""
    figure = picture([open_plot_input(expand_inputs([str(FIXTURES / f"good_{name}")])[0], InputOptions())]).figure
    assert figure_bytes(figure, "pdf").startswith(b"%PDF")


def test_snapshots_without_a_fix_are_noted(tmp_path: Path) -> None:
    """Without any position the figure has none, and a note gives the reason."""
    row = {"snapshot": 1, "method": "ml", "target": 0, "alternative": 0, "x_m": None, "y_m": None, "cov_xx_m2": None}
    row |= {"cov_xy_m2": None, "cov_yy_m2": None, "n_measurements": 1, "n_used": 0, "cost": None, "status": "too_few"}
    pyarrow.csv.write_csv(pa.Table.from_pylist([row]), tmp_path / "e.csv")
    opened = [open_plot_input(expand_inputs([str(tmp_path / "e.csv")])[0], InputOptions())]
    plotted = picture(opened, "scene")
    assert plotted.notes == ["ml: no position (too_few)"]
    assert figure_bytes(plotted.figure, "png")
    with pytest.raises(DataError, match="no estimate is a fix"):
        picture(opened, "estimates")


def test_positions_that_are_no_fix_are_crosses(tmp_path: Path) -> None:
    """The picture of a snapshot marks them by a cross and their status; that of the estimates leaves them out."""
    row = {"snapshot": 1, "method": "mixture-ml", "target": 0, "alternative": 0, "x_m": 3.0, "y_m": 4.0}
    row |= dict.fromkeys(("cov_xx_m2", "cov_xy_m2", "cov_yy_m2"))
    row |= {"n_measurements": 4, "n_used": 2, "cost": 1.0, "status": "no_consensus"}
    pyarrow.csv.write_csv(pa.Table.from_pylist([row]), tmp_path / "e.csv")
    opened = [open_plot_input(expand_inputs([str(tmp_path / "e.csv")])[0], InputOptions())]
    lines = picture(opened, "scene").figure.axes[0].get_lines()
    assert [(line.get_marker(), line.get_label()) for line in lines if line.get_xdata().tolist() == [3.0]] == [
        ("x", "mixture-ml: no fix (no_consensus)")
    ]
    with pytest.raises(DataError, match="no estimate is a fix"):
        picture(opened, "estimates")


def test_bands_of_a_track_are_those_of_its_covariances(files: Any) -> None:
    """Each track has a band per coordinate of 1.96 standard deviations to either side, and 12 ellipses."""
    opened = files("track")
    figure = picture(opened, by="walk").figure
    path, x, y = shown(figure)
    assert len(ellipses(path)) == 2 * 12
    assert len(legend_words(path)) == 2
    for axes, axis in ((x, "x"), (y, "y")):
        bands = axes.collections
        assert len(bands) == 2
        rows = made("track").to_pylist()
        mine = [row for row in rows if row["walk"] == rows[0]["walk"]]
        first = min(mine, key=lambda row: row["time_s"])
        half = 1.959964 * np.sqrt(first[f"cov_{axis}{axis}_m2"])
        ends = bands[0].get_paths()[0].vertices
        assert {round(float(value), 6) for value in ends[ends[:, 0] == 0.0, 1]} >= {
            round(first[f"{axis}_m"] - half, 6),
            round(first[f"{axis}_m"] + half, 6),
        }
    with pytest.raises(UsageError, match="no column 'tag'"):
        picture(opened, by="tag")
