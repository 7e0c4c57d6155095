"""The picture of a calibration: its numbers are those of the file, and those of numpy for residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet
import pytest
from deviation_worlds import design, drive
from program import run_here

import nlosctl
from nlosctl.contract.run_options import InputOptions
from nlosctl.io.calibrations.calibration_file import read_calibration
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.results.plot_inputs import PlotInput, open_plot_input
from nlosctl.io.results.residual_sectors import BINS, read_residuals

TOML = """
[[sensor]]
name = "s1"
session = "a"
heading_offset_deg = 1.5
heading_std_deg = 0.25
[[sensor]]
name = "s2"
session = "a"
heading_offset_deg = -2.0
heading_std_deg = 0.5
[[sensor]]
name = "s1"
session = "b"
heading_offset_deg = 0.5
"""


def points(axes: Any) -> list[npt.NDArray[np.float64]]:
    """Return the points (N, 2) of each series with error bars."""
    return [np.array(container.lines[0].get_xydata()) for container in axes.containers]


def turned_ring(folder: Path) -> pa.Table:
    """Write bearings whose sensor s2 is turned by 5 degrees; return them."""
    rows = nlosctl.simulate("ring", trials=60)
    off = np.where(np.array(rows["sensor"].to_pylist()) == "s2", np.radians(5.0), 0.0)
    bearing = pa.array(np.array(rows["bearing_rad"]) + off)
    rows = rows.set_column(rows.column_names.index("bearing_rad"), "bearing_rad", bearing)
    pyarrow.parquet.write_table(rows, folder / "rows.parquet")
    return rows


def opened(path: Path) -> PlotInput:
    """Return a file as an input of a plot."""
    return open_plot_input(expand_inputs([str(path)])[0], InputOptions())


def test_offsets_have_bars_of_one_std_by_group(tmp_path: Path) -> None:
    """Each group is a series at the offsets of the file; a sensor without a std is named below."""
    (tmp_path / "c.toml").write_text(TOML)
    plot = nlosctl.plot(tmp_path / "c.toml")
    (axes,) = plot.figure.axes
    assert plot.view == "calibration"
    first, second = points(axes)
    assert first[:, 1].tolist() == [1.5, -2.0]
    assert second[:, 1].tolist() == [0.5]
    assert np.round(first[:, 0]).tolist() == [0.0, 1.0]
    low, high = np.array(axes.containers[0].lines[2][0].get_segments())[0][:, 1]
    assert (low, high) == (1.25, 1.75)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["s1", "s2"]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["a", "b"]
    assert plot.notes == ("not determined: s1 b",)


def test_residuals_are_those_of_numpy(tmp_path: Path) -> None:
    """Means, standard deviations and sectors of ten degrees are those of the flags, from Parquet and CSV."""
    rows = turned_ring(tmp_path)
    flags = nlosctl.localize(rows, method="mixture-ml").flags
    pyarrow.parquet.write_table(flags, tmp_path / "flags.parquet")
    assert run_here("convert", "flags.parquet", "-o", "flags.csv", "-q", folder=tmp_path).returncode == 0
    names, used = np.array(flags["sensor"].to_pylist()), np.array(flags["used"].to_pylist())
    residual = np.degrees(np.array(flags["residual_rad"]))
    bearing = (np.degrees(np.array(flags["bearing_rad"])) + 180.0) % 360.0
    for name in ("flags.parquet", "flags.csv"):
        found = read_residuals(opened(tmp_path / name), "", (), InputOptions(), None, 1000)
        for sensor in ("s1", "s2"):
            mine = used & (names == sensor)
            assert found.mean_and_std((sensor,)) == pytest.approx((residual[mine].mean(), residual[mine].std()))
            _, means = found.by_direction((sensor,))
            sector = (bearing // (360.0 / BINS)).astype(int)
            expected = [residual[mine & (sector == k)] for k in range(BINS)]
            assert np.isnan(means).tolist() == [not values.size for values in expected]
            assert means[~np.isnan(means)] == pytest.approx([values.mean() for values in expected if values.size])


def test_measurements_appear_before_and_after(tmp_path: Path) -> None:
    """Measurements are localized without and with the calibration: afterwards the mean residuals are near 0."""
    turned_ring(tmp_path)
    assert run_here("calibrate", "rows.parquet", "-o", "c.toml", "-q", folder=tmp_path).returncode == 0
    plot = nlosctl.plot(tmp_path / "c.toml", tmp_path / "rows.parquet")
    assert len(plot.figure.axes) == 3
    before, after = points(plot.figure.axes[1])
    assert np.abs(before[:, 1]).max() > 3.0
    assert np.abs(after[:, 1]).max() < 0.05
    labels = {line.get_label() for line in plot.figure.axes[2].lines}
    assert {"s2, before", "s2, after"} <= labels


def test_directions_of_ranges_need_positions(tmp_path: Path) -> None:
    """Ranges have a direction by the truth or by estimates beside the flags, else a note states what to name."""
    toml = '[[sensor]]\nname = "s1"\nrange_offset_m = 0.1\nrange_offset_std_m = 0.01\n'
    (tmp_path / "c.toml").write_text(toml)
    found = nlosctl.localize(nlosctl.simulate("ranges", trials=20), method="ml")
    without = found.flags.drop_columns([name for name in found.flags.column_names if name.startswith("truth")])
    for name, table in (("flags", without), ("with_truth", found.flags), ("fixes", found.estimates)):
        pyarrow.parquet.write_table(table, tmp_path / f"{name}.parquet")
    places = opened(tmp_path / "fixes.parquet")
    sensor = found.flags["sensor"][0].as_py()
    by_truth, by_fix = (
        read_residuals(opened(tmp_path / name), "", (), InputOptions(), estimates, 1000).sectors[(sensor,)]
        for name, estimates in (("with_truth.parquet", None), ("flags.parquet", places))
    )
    assert by_truth[0].sum() == by_fix[0].sum() == 20
    lacking = nlosctl.plot(tmp_path / "c.toml", tmp_path / "flags.parquet")
    assert lacking.notes == ("residuals by direction need the positions: name the estimates too",)


def test_deviations_are_curves_by_the_direction_from_the_heading(tmp_path: Path) -> None:
    """The curve is the sum of the file's terms, its band one std; residuals follow it before, and not after."""
    table, _ = drive(300)
    pyarrow.parquet.write_table(table, tmp_path / "drive.parquet")
    words = ["calibrate", "drive.parquet", "--harmonics", "2", "--truth", "columns", "-o", "c.toml", "-q"]
    assert run_here(*words, folder=tmp_path).returncode == 0
    plot = nlosctl.plot(tmp_path / "c.toml", tmp_path / "drive.parquet")
    calibration = read_calibration(str(tmp_path / "c.toml"))
    curve, by_sensor, by_direction = plot.figure.axes
    direction, value = curve.lines[0].get_data()
    terms = design(np.radians(direction))
    assert value == pytest.approx(terms @ calibration.entries[0].terms)
    band = curve.collections[0].get_paths()[0].vertices
    std = np.sqrt(np.einsum("ni,ij,nj->n", terms, calibration.covariance, terms))
    assert band[:, 1].max() == pytest.approx((value + std).max())
    (_, (_, mean_after)) = (points(by_sensor)[0], points(by_sensor)[1][0])
    assert abs(mean_after) < 0.1
    lines = {line.get_label(): np.array(line.get_ydata()) for line in by_direction.lines}
    assert np.nanstd(lines["car, before"]) > 3.0
    assert np.nanstd(lines["car, after"]) < 1.0
    assert "from the heading" in by_direction.get_xlabel()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["c.toml", "ranges.parquet"], 1, "c.toml has offsets of bearings, and ranges.parquet ranges"),
        (["c.toml", "c2.toml"], 2, "no view suits"),
        (["missing.toml"], 1, "the calibration can't be read"),
        (["c.toml", "--view", "cdf"], 2, "--view cdf takes estimates with truth"),
    ],
)
def test_what_does_not_suit_is_one_line(tmp_path: Path, words: list[str], code: int, message: str) -> None:
    """Other kinds, two calibrations, and missing files are errors of one line."""
    for name in ("c.toml", "c2.toml"):
        (tmp_path / name).write_text(TOML)
    pyarrow.parquet.write_table(nlosctl.simulate("ranges", trials=2), tmp_path / "ranges.parquet")
    done = run_here("plot", *words, "-o", "x.svg", folder=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (code, 1)
    assert message in done.stderr.decode()
