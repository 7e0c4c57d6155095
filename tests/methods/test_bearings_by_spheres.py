"""Monte Carlo of ls, stansfield and ml on azimuths and elevations by a sphere around a globe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_worlds import dense_covariance, space_batch

from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.models.sight import bearing_lines
from nlosctl.scenarios.catalogue import scenarios

METHODS = {module.METHOD.name: module.METHOD for module in (bearings_ls, bearings_stansfield, bearings_ml)}


def draw_skywave(runs: int, seed: int, std_deg: float):
    """Return a batch of four stations that see sources by the ionosphere, and the sources (B, 3)."""
    spec = scenarios()["skywave"]
    options = spec.options(angle_std_deg=std_deg)
    columns = spec.generate(options, np.random.default_rng(seed), runs)
    block = {name: values.reshape(runs, -1) for name, values in columns.items() if values.dtype.kind == "f"}
    sensor = np.stack([block[f"sensor_{axis}_m"] for axis in "xyz"], axis=-1)
    batch = space_batch(
        sensor,
        block["bearing_rad"],
        block["elevation_rad"],
        block["bearing_std_rad"],
        block["elevation_std_rad"],
        scene=spec.scene(options),
        reflector=np.zeros(sensor.shape[:2], dtype=np.int64, order="F"),
    )
    return batch, np.stack([block[f"truth_{axis}_m"][:, 0] for axis in "xyz"], axis=1)


@pytest.mark.parametrize("std_deg", [0.1, 0.5, pytest.param(1.5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", METHODS)
def test_errors_and_covariances_agree_with_the_bound(name: str, std_deg: float):
    """600 runs: RMSE over the bound, NEES of 3 within its 99.9 % interval, and the share of 95 % ellipsoids."""
    batch, source = draw_skywave(600, 1, std_deg)
    method = METHODS[name]
    estimates = method.solve(batch, method.options()).estimates
    best = np.flatnonzero(estimates.alternative == 0)
    judged = np.isfinite(estimates.covariance_m2[best]).all(axis=1)
    assert judged.mean() > 0.98
    error = (estimates.position_m[best] - source)[judged]
    covariance = dense_covariance(estimates.covariance_m2[best][judged])
    nees = np.einsum("bi,bi->b", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert 2.68 < nees.mean() < 3.34
    assert 0.93 <= (nees <= 7.815).mean() <= 0.975
    assert set(estimates.status[best]) <= {Status.OK, Status.INFEASIBLE, Status.DEGENERATE}
    if name != "ls":
        lines = bearing_lines(batch)
        bound = lines.information(*(source[:, axis] - lines.center[axis] for axis in range(3))).inverse().trace
        assert 0.93 < np.sqrt((error**2).sum(axis=1).mean() / bound[judged].mean()) < 1.07


@pytest.mark.parametrize("name", METHODS)
def test_flags_mark_directions_below_the_horizon(name: str):
    """``under_horizon`` is where the ray, from a station on the globe, points below the tangent plane there."""
    batch, _ = draw_skywave(50, 2, 0.1)
    sunk = batch.elevation_rad.copy(order="F")
    sunk[:, 0] = np.random.default_rng(3).uniform(-0.3, 0.3, 50)
    batch = replace(batch, elevation_rad=sunk)
    level = np.cos(sunk)
    ray = np.stack([level * np.cos(batch.bearing_rad), level * np.sin(batch.bearing_rad), np.sin(sunk)], axis=-1)
    (sphere,) = batch.scene.reflectors
    up = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1) - np.array(sphere.center)
    expected = np.einsum("bki,bki->bk", ray, up) < 0.0
    assert 10 < expected.sum() < 40
    method = METHODS[name]
    assert (method.solve(batch, method.options()).flags.columns["under_horizon"] == expected).all()
    names = method.flag_columns(method.options(), batch.scene, ("elevation_rad",), details=False, dimension=3)
    assert "under_horizon" in names
    clear = Scene(reflectors=(replace(sphere, blocker_radius=None),))
    assert "under_horizon" not in method.solve(replace(batch, scene=clear), method.options()).flags.columns
    names = method.flag_columns(method.options(), clear, ("elevation_rad",), details=False, dimension=3)
    assert "under_horizon" not in names
