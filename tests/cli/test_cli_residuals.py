"""``evaluate --by`` on flags: figures of standardized residuals compared with numpy's."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.errors import UsageError

Floats = npt.NDArray[np.float64]


def expected(values: Floats) -> dict[str, float]:
    """Return numpy's mean, std and autocorrelation at lag 1."""
    deviation = values - values.mean()
    together = np.sum(deviation[1:] * deviation[:-1]) / np.sum(deviation**2)
    return {"mean": float(values.mean()), "std": float(values.std(ddof=1)), "autocorrelation": float(together)}


def column(table: Any, name: str) -> Floats:
    """Return a column of numbers, null as NaN."""
    return np.array(table[name].to_pylist(), dtype=np.float64)


def flags_of(scenario: str, folder: Path, *words: str, trials: int = 60, **parameters: Any) -> pa.Table:
    """Write measurements and their flags to ``folder``; return the flags."""
    pyarrow.parquet.write_table(nlosctl.simulate(scenario, trials=trials, **parameters), folder / "rows.parquet")
    targets = ["-o", "fixes.parquet", "--flags-out", "flags.parquet", "--overwrite"]
    done = run_here("localize", "rows.parquet", *words, *targets, folder=folder)
    assert done.returncode == 0, done.stderr
    return pyarrow.parquet.read_table(folder / "flags.parquet")


CASES: list[tuple[str, list[str], dict[str, Any], dict[str, tuple[str, str]]]] = [
    ("ring", ["-m", "ml"], {}, {"residual": ("residual_rad", "bearing_std_rad")}),
    ("ring", ["-m", "mixture-ml"], {"outlier_fraction": 0.2}, {"residual": ("residual_rad", "bearing_std_rad")}),
    ("ranges", ["-m", "ml"], {}, {"residual": ("residual_m", "range_std_m")}),
    ("arrivals", ["-m", "ml"], {}, {"residual": ("residual_m", "arrival_std_m")}),
    (
        "space-ring",
        ["-m", "ml"],
        {"azimuth_only": 0.3},
        {
            "residual": ("residual_rad", "bearing_std_rad"),
            "residual_elevation": ("residual_elevation_rad", "elevation_std_rad"),
        },
    ),
    ("box", ["-m", "ml", "--dimensions", "3"], {}, {"residual": ("residual_m", "range_std_m")}),
]


@pytest.mark.parametrize(("scenario", "words", "parameters", "columns"), CASES)
def test_figures_are_those_of_numpy(
    tmp_path: Path, scenario: str, words: list[str], parameters: dict[str, Any], columns: dict[str, tuple[str, str]]
) -> None:
    """For every kind, in the plane and in space, by sensor, over the rows used; outliers are beyond three stds."""
    flags = flags_of(scenario, tmp_path, *words, **parameters)
    found = {row["sensor"]: row for row in nlosctl.evaluate(flags, by=["sensor"]).groups}
    names = np.array(flags["sensor"].to_pylist())
    assert set(found) == set(names.tolist())
    used = np.array(flags["used"].to_pylist())
    for name, row in found.items():
        worst = np.zeros(np.count_nonzero(names == name))
        for figure, (residual, std) in columns.items():
            values = (column(flags, residual) / column(flags, std))[names == name]
            worst = np.fmax(worst, np.abs(values))
            counted = values[used[names == name] & np.isfinite(values)]
            for word, value in expected(counted).items():
                assert row[f"{figure}_{word}"] == pytest.approx(value, rel=1e-9, abs=1e-12)
        assert row["outlier_share"] == np.count_nonzero(worst > 3.0) / worst.size
        assert row["rows"] == worst.size


def test_an_offset_shows_and_a_calibration_removes_it(tmp_path: Path) -> None:
    """A heading off by 5 std gives a mean far from 0; after its calibration the residuals have the std of the fit."""
    rows = nlosctl.simulate("ring", trials=200)
    off = np.where(np.array(rows["sensor"].to_pylist()) == "s2", np.radians(5.0), 0.0)
    place = rows.column_names.index("bearing_rad")
    turned = rows.set_column(place, "bearing_rad", pa.array(np.array(rows["bearing_rad"]) + off))
    before = nlosctl.localize(turned, method="ml").flags
    by_sensor = {row["sensor"]: row for row in nlosctl.evaluate(before, by=["sensor"]).groups}
    assert max(by_sensor, key=lambda name: abs(by_sensor[name]["residual_mean"])) == "s2"
    assert by_sensor["s2"]["residual_mean"] > 3.0
    half = pa.array(0.5 * np.array(turned["bearing_std_rad"]))
    stated = turned.set_column(turned.column_names.index("bearing_std_rad"), "bearing_std_rad", half)
    calibration = nlosctl.calibrate(stated, method="ml").calibration
    after = nlosctl.localize(stated, method="ml", calibration=calibration).flags
    for row in nlosctl.evaluate(after, by=["sensor"]).groups:
        assert abs(row["residual_mean"]) < 0.01
        assert row["residual_std"] == pytest.approx(np.sqrt(6.0 / 8.0), rel=0.1)  # 8 rows, 2 unknowns


def test_the_cut_of_the_file_changes_no_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches of 7 rows, parts of a folder, and the whole give equal figures."""
    flags = flags_of("ring", tmp_path, "-m", "ml", trials=40)
    whole = nlosctl.evaluate(flags, by=["sensor"]).groups
    (tmp_path / "parts").mkdir()
    for number, start in enumerate(range(0, flags.num_rows, 100)):
        pyarrow.parquet.write_table(flags.slice(start, 100), tmp_path / "parts" / f"part-{number}.parquet")
    monkeypatch.setenv("NLOSCTL_CHUNK_ROWS", "7")
    assert nlosctl.evaluate(flags, by=["sensor"]).groups == whole
    assert nlosctl.evaluate(tmp_path / "parts", by=["sensor"]).groups == whole


def test_formats_groups_and_conditions(tmp_path: Path) -> None:
    """CSV, JSON Lines and JSON hold the same figures; several columns and conditions work as for estimates."""
    flags_of("ring", tmp_path, "-m", "ml", "-m", "stansfield", trials=20)

    def run(*words: str) -> Any:
        return run_here("evaluate", "flags.parquet", "--by", "sensor", *words, folder=tmp_path)

    table = pyarrow.csv.read_csv(io.BytesIO(run("--format", "csv").stdout))
    groups = json.loads(run("--json").stdout)["groups"]
    lines = [json.loads(line) for line in run("--format", "jsonl").stdout.splitlines()]
    assert table.column_names[:3] == ["of", "method", "sensor"]
    assert len(groups) == len(lines) == table.num_rows == 16
    assert table["residual_std"].to_pylist() == [row["residual_std"] for row in groups]
    assert [line["residual_std"] for line in lines] == [row["residual_std"] for row in groups]
    text = run("--format", "text").stdout.decode().splitlines()
    assert text[0].split()[:3] == ["group", "rows", "rows_used"]
    assert text[1].split()[:2] == ["ml", "sensor=s1"]
    assert run("--fail-if", "ml:residual_std>0.1").returncode == 4
    assert run("--fail-if", "residual_std>9").returncode == 0
    assert run("--fail-if", "rmse_m>9").returncode == 2
    both = json.loads(run("--by", "snapshot", "--json").stdout)["groups"]
    assert len(both) == 320
    assert both[0]["residual_std"] is None  # of one row


def test_columns_in_other_units_and_factors(tmp_path: Path) -> None:
    """Stds in degrees, factors of stds and stds across the ray enter as in the measurement."""
    flags = flags_of("ring", tmp_path, "-m", "ml", trials=20)
    values = nlosctl.evaluate(flags, by=["sensor"]).groups
    std = column(flags, "bearing_std_rad")
    others = flags.drop_columns(["bearing_std_rad"])
    for changed in (
        others.append_column("bearing_std_deg", pa.array(np.degrees(std))),
        others.append_column("std_factor", pa.array(std)),
        flags.append_column("std_factor", pa.array(np.ones(std.size))),
        others.append_column("direction_std_rad", pa.array(std * np.cos(0.5))).append_column(
            "elevation_deg", pa.array(np.full(std.size, np.degrees(0.5)))
        ),
    ):
        for found, row in zip(nlosctl.evaluate(changed, by=["sensor"]).groups, values, strict=True):
            assert found["sensor"] == row["sensor"]
            assert found["residual_std"] == pytest.approx(row["residual_std"], rel=1e-12)
            assert found["residual_mean"] == pytest.approx(row["residual_mean"], rel=1e-12)
    sound = flags_of("arrivals", tmp_path, "-m", "ml", trials=20)
    arrival_std_s = pa.array(column(sound, "arrival_std_m") / 343.0)
    timed = sound.drop_columns(["arrival_std_m"]).append_column("arrival_std_s", arrival_std_s)
    whole, again = (nlosctl.evaluate(table, by=["sensor"], speed_m_s="sound").groups for table in (sound, timed))
    assert [row["residual_mean"] for row in again] == pytest.approx([row["residual_mean"] for row in whole])


@pytest.mark.parametrize(
    ("without", "words", "message"),
    [
        (["residual_rad"], ["--by", "sensor"], "no residual column, such as 'residual_rad' or 'residual_m'"),
        (["bearing_std_rad"], ["--by", "sensor"], "'residual_rad' has no standard deviation: no column"),
        ([], ["--by", "senor"], "--by senor: no column 'senor' (did you mean 'sensor'?)"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, without: list[str], words: list[str], message: str) -> None:
    """One line states what flags lack, and how to get it."""
    flags = flags_of("ring", tmp_path, "-m", "ml", trials=3)
    pyarrow.parquet.write_table(flags.drop_columns(without), tmp_path / "less.parquet")
    done = run_here("evaluate", "less.parquet", *words, folder=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr.decode()
    assert len(done.stderr.decode().splitlines()) == 1


def test_a_bad_std_is_an_error(tmp_path: Path) -> None:
    """A standard deviation of zero is named with its column."""
    flags = flags_of("ring", tmp_path, "-m", "ml", trials=3)
    zeros = flags.set_column(flags.column_names.index("bearing_std_rad"), "bearing_std_rad", pa.array(np.zeros(24)))
    pyarrow.parquet.write_table(zeros, tmp_path / "zeros.parquet")
    done = run_here("evaluate", "zeros.parquet", "--by", "sensor", folder=tmp_path)
    assert (done.returncode, b"'bearing_std_rad': got 0, expected a positive number" in done.stderr) == (1, True)


def test_estimates_by_a_column(tmp_path: Path) -> None:
    """Estimates have their usual figures for each value; a column called like a figure is refused."""
    flags_of("ring", tmp_path, "-m", "ml", trials=30)
    fixes = pyarrow.parquet.read_table(tmp_path / "fixes.parquet")
    day = pa.array([f"d{row % 3}" for row in range(30)])
    groups = nlosctl.evaluate(fixes.append_column("day", day), by=["day"]).groups
    alone = [nlosctl.evaluate(fixes.filter(pa.array([row % 3 == k for row in range(30)]))).groups[0] for k in range(3)]
    assert [row["day"] for row in groups] == ["d0", "d1", "d2"]
    assert [row["rmse_m"] for row in groups] == [row["rmse_m"] for row in alone]
    with pytest.raises(UsageError, match="a figure 'rows' of their own"):
        nlosctl.evaluate(fixes.append_column("rows", day), by=["rows"])
