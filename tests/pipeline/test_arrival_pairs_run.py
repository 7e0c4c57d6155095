"""Independent differences of pairs in whole runs: mixed files, the bound, methods and plugins that can't, the earth."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import nlosctl
from nlosctl.errors import UsageError
from nlosctl.geometry.earth_centred import to_earth_centred
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.methods import arrivals_ml
from nlosctl.pipeline.solve.reference_rows import lacks_reference

OFFSETS = ["offset_m", "offset_std_m", "cov_x_offset_m2", "cov_y_offset_m2"]


def mixed() -> Any:
    """Return 30 snapshots of 7 rows: differences to the first sensor, its row lacking, and of pairs in turn."""
    drawn = nlosctl.simulate("arrivals", trials=30, seed=4, pairs=7)
    columns = {name: drawn[name].to_pylist() for name in drawn.column_names}
    one = nlosctl.simulate("arrivals", trials=30, seed=4)
    arrivals = {name: one[name].to_pylist() for name in one.column_names}
    for snapshot in range(0, 30, 2):
        for row in range(7):
            here, there, first = 7 * snapshot + row, 8 * snapshot + row + 1, 8 * snapshot
            for name in ("sensor", "sensor_x_m", "sensor_y_m", "truth_x_m", "truth_y_m"):
                columns[name][here] = arrivals[name][there]
            columns["tdoa_m"][here] = arrivals["arrival_m"][there] - arrivals["arrival_m"][first]
            for name in ("", "_x_m", "_y_m"):
                columns[f"reference{name}"][here] = arrivals[f"sensor{name}"][first]
    return pa.table(columns)


def test_a_file_may_have_snapshots_of_both_forms() -> None:
    """Each snapshot is solved as if it were alone, whatever the block size; only those of one reference have offsets.

    The rows of both have flags in the order of the file.
    """
    table = mixed()
    whole = nlosctl.localize(table, method="ml")
    small = nlosctl.localize(table, method="ml", block_size=2)
    assert whole.estimates.equals(small.estimates)
    assert whole.flags.equals(small.flags)
    estimates = whole.estimates.to_pydict()
    assert estimates["status"] == ["ok"] * 30
    assert estimates["n_used"] == [7] * 30
    for name in OFFSETS:
        assert [value is None for value in estimates[name]] == [number % 2 == 1 for number in range(30)]
    for snapshot in (0, 1):
        alone = nlosctl.localize(table.slice(7 * snapshot, 7), method="ml")
        assert alone.estimates["x_m"][0].as_py() == estimates["x_m"][snapshot]
        assert alone.flags["residual_m"].to_pylist() == whole.flags["residual_m"].to_pylist()[7 * snapshot :][:7]
    assert whole.flags["used"].to_pylist() == [True] * 210


def test_the_fit_and_the_bound_are_of_as_many_scalars_as_rows() -> None:
    """p-values of 1000 fits are uniform, and the RMSE is that of the bound."""
    drawn = nlosctl.simulate("arrivals", trials=1000, seed=9, pairs=9)
    estimates = nlosctl.localize(drawn, method="ml").estimates
    p_values = np.sort(np.asarray(estimates["fit_p_value"]))
    assert np.abs(p_values - (np.arange(1000) + 0.5) / 1000).max() < 1.63 / np.sqrt(1000)
    truth = [np.asarray(drawn[f"truth_{axis}_m"])[::9] for axis in "xy"]
    squared = sum((np.asarray(estimates[f"{axis}_m"]) - known) ** 2 for axis, known in zip("xy", truth, strict=True))
    bound = np.asarray(nlosctl.bound(drawn)["rms_m"])
    assert np.sqrt(squared.mean() / np.mean(bound**2)) == pytest.approx(1.0, abs=0.07)


def test_unknown_stds_are_estimated_of_differences() -> None:
    """The factor of 400 snapshots has the mean square of the true std, 2 m, by seven degrees of freedom."""
    drawn = nlosctl.simulate("arrivals", trials=400, seed=9, pairs=9, arrival_std_m=2.0).drop_columns(["arrival_std_m"])
    estimates = nlosctl.localize(drawn, method="ml", estimate_std="snapshot").estimates
    assert set(estimates["std_dof"].to_pylist()) == {7.0}
    assert np.mean(np.asarray(estimates["std_factor"]) ** 2) == pytest.approx(4.0, abs=0.35)


def test_methods_of_one_reference_are_refused() -> None:
    """srd-ls, and a plugin that does not read references, must not take independent differences for arrivals."""
    drawn = nlosctl.simulate("arrivals", trials=3, seed=9, pairs=9)
    with pytest.raises(UsageError, match="snapshot 0: differences to several references, but method 'srd-ls' needs"):
        nlosctl.localize(drawn, method="srd-ls")
    plugin = dataclasses.replace(arrivals_ml.METHOD, name="mine", reads=frozenset())
    columns = {FORM: np.array([Form.OF_PAIRS])}
    chunk: Any = type("Chunk", (), {"source": "in.csv", "snapshot": pa.array(["a", "b"]), "columns": columns})
    with pytest.raises(UsageError, match=r"in\.csv, snapshot 'b': .*'mine' needs one reference"):
        lacks_reference(plugin, chunk, 1, np.zeros((1, 1), dtype=np.int64))


def test_epochs_are_of_pairs(tmp_path: Path) -> None:
    """With window auto an epoch ends when a pair repeats, not when a sensor does; nearest keeps a row of each pair."""
    rows = ["time_s,sensor,sensor_x_m,sensor_y_m,reference,tdoa_m,arrival_std_m"]
    places = {"a": (0.0, 0.0), "b": (10.0, 0.0), "c": (10.0, 10.0), "d": (0.0, 10.0)}
    for epoch in range(3):
        for number, (own, other) in enumerate(["ab", "bc", "cd", "ac", "da"]):
            away = [np.hypot(places[name][0] - 4.0, places[name][1] - 3.0) for name in (own, other)]
            time = 10.0 * epoch + 0.1 * number
            rows.append(f"{time},{own},{places[own][0]},{places[own][1]},{other},{away[0] - away[1]},0.1")
    path = tmp_path / "in.csv"
    path.write_text("\n".join(rows) + "\n")
    auto = nlosctl.localize(str(path), method="ml", window="auto").estimates.to_pydict()
    assert auto["n_used"] == [5, 5, 5]
    assert auto["x_m"] == pytest.approx([4.0] * 3, abs=1e-6)
    nearest = nlosctl.localize(str(path), method="ml", window="20s", window_keep="nearest").estimates.to_pydict()
    assert nearest["n_used"] == [5, 5]


def test_pairs_on_earth_are_straight_lines(tmp_path: Path) -> None:
    """In three dimensions latitudes and longitudes give the place whose straight distances are those measured."""
    stations = {"a": (50.0, 8.0, 120.0), "b": (50.01, 8.6, 340.0), "c": (50.5, 8.5, 90.0), "d": (50.4, 7.9, 210.0)}
    place = np.array(to_earth_centred(np.radians(50.25), np.radians(8.3), np.float64(10360.0)))
    away = {
        name: np.linalg.norm(place - to_earth_centred(np.radians(lat), np.radians(lon), np.float64(height)))
        for name, (lat, lon, height) in stations.items()
    }
    rows = ["sensor,sensor_lat_deg,sensor_lon_deg,sensor_z_m,tdoa_m,reference,arrival_std_m"]
    for own, other in ("ab", "bc", "cd", "da", "ac"):
        lat, lon, height = stations[own]
        rows.append(f"{own},{lat},{lon},{height},{away[own] - away[other]},{other},1")
    path = tmp_path / "in.csv"
    path.write_text("\n".join(rows) + "\n")
    found = nlosctl.localize(str(path), method="ml", dimensions=3, alternatives=2).estimates.to_pydict()
    errors = np.abs([np.array(found["lat_deg"]) - 50.25, np.array(found["lon_deg"]) - 8.3])
    best = int(np.argmin(errors.sum(axis=0)))
    assert errors[:, best] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found["height_m"][best] == pytest.approx(10360.0, abs=1e-3)
