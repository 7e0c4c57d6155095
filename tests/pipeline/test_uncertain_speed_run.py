"""The std of the wave's speed in whole runs: columns of times and metres, the bound, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.errors import UsageError


def test_times_and_metres_have_the_same_scale_error() -> None:
    """Arrivals in seconds, and in metres by the same speed, give the same estimates; a std of 0 is that of none."""
    metres = nlosctl.simulate("arrivals", trials=20, seed=2, speed_std=0.01)
    seconds = metres.drop_columns(["arrival_m"]).append_column("arrival_s", [np.asarray(metres["arrival_m"]) / 343.0])
    speed = {"speed_m_s": "sound", "speed_std_m_s": 3.43}
    one, other = (nlosctl.localize(table, method="ml", **speed).estimates for table in (metres, seconds))
    for name in ("x_m", "y_m", "cov_xx_m2", "offset_std_m"):
        np.testing.assert_allclose(np.asarray(one[name]), np.asarray(other[name]), rtol=1e-6)
    none = nlosctl.localize(metres, method="ml", speed_m_s=343.0, speed_std_m_s=0).estimates
    assert none["x_m"].equals(nlosctl.localize(metres, method="ml").estimates["x_m"])


@pytest.mark.parametrize("pairs", [0, 12])
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_bound_includes_the_speed(dimension: int, pairs: int) -> None:
    """The RMSE of 1000 fixes is that of the bound, which is above that of a known speed; p-values are uniform."""
    drawn = nlosctl.simulate(
        "arrivals", trials=1000, seed=3, speed_std=0.01, dimensions=str(dimension), sensor_height_m=300.0, pairs=pairs
    )
    options = {"speed_m_s": 343.0, "speed_std_m_s": 3.43, "dimensions": dimension}
    estimates = nlosctl.localize(drawn, method="ml", **options).estimates
    bound = np.asarray(nlosctl.bound(drawn, **options)["rms_m"])
    rows, axes = pairs or 8, "xyz"[:dimension]
    squared = sum(
        (np.asarray(estimates[f"{axis}_m"]) - np.asarray(drawn[f"truth_{axis}_m"])[::rows]) ** 2 for axis in axes
    )
    assert np.sqrt(squared.mean() / np.mean(bound**2)) == pytest.approx(1.0, abs=0.07)
    assert bound.mean() > 1.2 * np.asarray(nlosctl.bound(drawn, dimensions=dimension)["rms_m"]).mean()
    p_values = np.sort(np.asarray(estimates["fit_p_value"]))
    assert np.abs(p_values - (np.arange(1000) + 0.5) / 1000).max() < 1.63 / np.sqrt(1000)


def test_flags_are_those_of_the_likeliest_speed() -> None:
    """The mean square of the residuals is that of the arrivals' noise, not that of the scale error."""
    drawn = nlosctl.simulate("arrivals", trials=300, seed=4, speed_std=0.02)
    speed = {"speed_m_s": "sound", "speed_std_m_s": 6.86}
    residual = np.asarray(nlosctl.localize(drawn, method="ml", **speed).flags["residual_m"])
    assert np.mean(residual**2) == pytest.approx((8 - 4) / 8, abs=0.08)
    plain = np.asarray(nlosctl.localize(drawn, method="ml").flags["residual_m"])
    assert np.mean(plain**2) > 0.9


@pytest.mark.parametrize(("options", "fault"), [
    ({"speed_m_s": 343.0, "speed_std_m_s": -1.0}, "`speed_std_m_s` must be a finite number of at least 0. Got -1"),
    ({"speed_m_s": 343.0, "speed_std_m_s": float("inf")}, "`speed_std_m_s` must be a finite number of at least 0"),
    ({"speed_m_s": 343.0, "speed_std_m_s": 100.0}, "must be at most a quarter of the speed, 343. Got 100 instead"),
    ({"speed_std_m_s": 1.0}, "`speed_std_m_s` needs the speed of the wave: set `speed_m_s`. Got 1 for light."),
    ({"speed_m_s": 343.0, "speed_std_m_s": 3.0, "method": "srd-ls"}, "'srd-ls' takes the speed of the wave as exactly"),
])  # fmt: skip
def test_faults_are_usage_errors(options: dict[str, object], fault: str) -> None:
    """A std that can't be one, of light, or of a method that takes the speed as exact is refused in one line."""
    drawn = nlosctl.simulate("arrivals", trials=2, seed=2)
    with pytest.raises(UsageError) as caught:
        nlosctl.localize(drawn, **{"method": "ml", **options})
    assert fault in str(caught.value)


def test_it_is_for_arrivals_with_gaussian_errors() -> None:
    """Ranges have no speed, and the bound of Laplacian errors does not include it."""
    speed = {"speed_m_s": 343.0, "speed_std_m_s": 3.0}
    with pytest.raises(UsageError, match=r"`speed_std_m_s` is for arrivals, and .* has ranges; leave it out"):
        nlosctl.localize(nlosctl.simulate("mixed-ranges", trials=2), method="r-ls", **speed)
    with pytest.raises(UsageError, match="`speed_std_m_s` is for the bound of gaussian errors"):
        nlosctl.bound(nlosctl.simulate("arrivals", trials=2), noise="laplace", **speed)


@pytest.mark.process
def test_the_command_line_has_the_option(tmp_path: Path) -> None:
    """localize takes --speed-std-m-s and records it; validate takes it too."""
    assert run_here("simulate", "arrivals", "-n", "5", "-q", "-o", "in.csv", folder=tmp_path).returncode == 0
    speed = ["--speed-m-s", "sound", "--speed-std-m-s", "2"]
    assert run_here("validate", "in.csv", *speed, folder=tmp_path).returncode == 0
    done = run_here("localize", "-m", "ml", "in.csv", *speed, "-q", "-o", "out.parquet", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    metadata = pyarrow.parquet.read_schema(tmp_path / "out.parquet").metadata
    recorded = next(json.loads(text) for text in metadata.values() if b"localize" in text and text.startswith(b"{"))
    assert recorded["speed_m_s"] == 343.0
    assert recorded["speed_std_m_s"] == 2.0
