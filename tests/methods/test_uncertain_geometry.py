"""Fixes, covariances and bounds where sensors and mirrors are not exactly known, against slow solutions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from uncertain_worlds import IN_SPACE, WORLDS, World, reference_fix, sample

import nlosctl
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError, UsageError

EVERY = {**WORLDS, **IN_SPACE}
MINIMIZES = {"bearings": "ml", "ranges": "r-ls", "arrivals": "ml"}


def solved(world: World, table, method: str, scene: Scene | None = None):
    """Return the positions (B, D), covariances (B, D, D), NaN without one, and estimates of a table."""
    read = {"kind": world.kind, "dimensions": world.dimension, "scene": world.scene() if scene is None else scene}
    estimates = nlosctl.localize(table, method=method, **read).estimates.to_pylist()
    axes = "xyz"[: world.dimension]
    position = np.array([[row[f"{axis}_m"] for axis in axes] for row in estimates], dtype=float)
    names = [["cov_" + "".join(sorted((one, other))) + "_m2" for other in axes] for one in axes]
    covariance = np.array([[[row[name] for name in some] for some in names] for row in estimates], dtype=float)
    return position, covariance, estimates


def squares(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return e'C^-1 e (B,) of errors with a covariance."""
    known = np.isfinite(covariance[:, 0, 0])
    return np.einsum("bi,bi->b", error[known], np.linalg.solve(covariance[known], error[known][..., None])[..., 0])


@pytest.mark.parametrize("name", EVERY)
def test_fixes_solve_the_equations_of_all_causes(name: str) -> None:
    """Where all rows are trusted A'R^-1 r = 0 at the fix, the covariance is (A'R^-1 A)^-1, the cost half r'R^-1 r."""
    world = EVERY[name]
    table, _, values = sample(world, 8, seed=21)
    position, covariance, estimates = solved(world, table, MINIMIZES[world.kind])
    agreed = 0
    for number, row in enumerate(estimates):
        fix, expected, square = reference_fix(world, values[number], position[number])
        away = np.sqrt(squares((fix - position[number])[None], expected[None])[0] / world.dimension)
        close = np.abs(np.diag(covariance[number]) / np.diag(expected) - 1.0).max()
        agreed += bool(away < 0.02 and close < 0.01 and abs(2.0 * row["cost"] - square) < 1e-3 * (1.0 + square))
    assert agreed >= 7


@pytest.mark.parametrize("name", ["places", "two mirrors", "directions by a ceiling"])
def test_stansfield_weighs_lines_by_all_causes(name: str) -> None:
    """Its fixes are within .15 standard deviations of those of maximum likelihood, its covariances within 10 %."""
    world = EVERY[name]
    table, _, values = sample(world, 6, seed=22)
    position, covariance, _ = solved(world, table, "stansfield")
    for number in range(6):
        fix, expected, _ = reference_fix(world, values[number], position[number])
        assert squares((fix - position[number])[None], expected[None])[0] < world.dimension * 0.15**2
        np.testing.assert_allclose(np.diag(covariance[number]), np.diag(expected), rtol=0.1)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        *((name, MINIMIZES[EVERY[name].kind]) for name in ("headings", "two mirrors", "ranges", "arrivals")),
        *((name, "stansfield") for name in ("places", "two mirrors")),
        *((name, "mixture-ml") for name in ("two mirrors", "ranges")),
    ],
)
def test_ellipses_hold_the_sources(name: str, method: str) -> None:
    """Over worlds of their own the mean NEES is the dimension, and p-values of fits are uniform.

    If the geometry is taken as exact, the NEES is much larger.
    """
    world = EVERY[name]
    table, sources, _ = sample(world, 250, seed=23)
    position, covariance, estimates = solved(world, table, method)
    likely = np.array([row["fit_p_value"] for row in estimates if row["fit_p_value"] is not None])
    assert abs(likely.mean() - 0.5) < 0.12
    assert (likely < 0.05).mean() < 0.1
    nees = squares(position - sources, covariance)
    assert nees.size > 240
    assert abs(nees.mean() / world.dimension - 1.0) < 0.2
    exact = dataclasses.replace(
        world, position_std_m=0.0, offset_std=0.0, mirror_stds=[(0.0, 0.0) for _ in world.mirror_stds]
    )
    position, covariance, _ = solved(world, table, method, exact.scene())
    assert squares(position - sources, covariance).mean() > 1.5 * nees.mean()


@pytest.mark.parametrize("name", ["headings", "two mirrors", "ranges by a mirror", "arrivals", *IN_SPACE])
def test_the_bound_is_that_of_all_causes(name: str) -> None:
    """The bound at the truth is (A'R^-1 A)^-1 there."""
    world = EVERY[name]
    table, sources, _ = sample(world, 3, seed=24)
    read = {"kind": world.kind, "dimensions": world.dimension}
    for number, row in enumerate(nlosctl.bound(table, scene=world.scene(), **read).to_pylist()):
        exact = world.predict(sources[number], np.zeros(world.causes().size))
        _, expected, _ = reference_fix(world, exact, sources[number])
        assert row["bound_xx_m2"] == pytest.approx(expected[0, 0], rel=1e-3)
        assert row["bound_xy_m2"] == pytest.approx(expected[0, 1], rel=1e-3, abs=1e-3 * expected[0, 0])


def test_the_offset_of_arrivals_has_the_covariance_of_all_unknowns() -> None:
    """Offset, its std and its covariance with the position are those of dense generalized least squares."""
    world = WORLDS["arrivals"]
    table, _, values = sample(world, 3, seed=25)
    position, _, estimates = solved(world, table, "ml")
    stds = world.causes()
    for number, row in enumerate(estimates):
        point = position[number]
        away = point - world.sensors
        along = away / np.linalg.norm(away, axis=1)[:, None]
        slopes = np.column_stack([along, np.ones(6)])
        effect = np.column_stack([*(np.diag(-along[:, axis]) for axis in range(2)), np.eye(6)])
        places = [stds[axis:12:2] for axis in range(2)]
        effect = effect * np.concatenate([*places, stds[12:]])
        whole = np.linalg.inv(world.std**2 * np.eye(6) + effect @ effect.T)
        covariance = np.linalg.inv(slopes.T @ whole @ slopes)
        residual = values[number] - np.linalg.norm(away, axis=1)
        offset = (covariance @ slopes.T @ whole @ residual)[2]
        assert row["offset_m"] == pytest.approx(offset, abs=1e-3)
        assert row["offset_std_m"] == pytest.approx(np.sqrt(covariance[2, 2]), rel=1e-4)
        assert row["cov_x_offset_m2"] == pytest.approx(covariance[0, 2], rel=1e-3, abs=1e-4)


def test_a_column_takes_the_place_of_the_scene() -> None:
    """Positions of the rows' own standard deviation; an empty cell has that of the scene."""
    world = WORLDS["places"]
    table, _, _ = sample(world, 4, seed=26)
    expected = solved(world, table, "ml")[1]
    size = len(table["sensor"])
    exact = dataclasses.replace(world, position_std_m=0.0)
    given = {**table, "sensor_std_m": np.full(size, 10.0)}
    np.testing.assert_allclose(solved(exact, given, "ml")[1], expected, rtol=1e-9)
    np.testing.assert_allclose(
        solved(world, {**table, "sensor_std_m": [None] * (size - 1) + [10.0]}, "ml")[1], expected
    )
    assert (solved(world, {**table, "sensor_std_m": np.zeros(size)}, "ml")[1] < expected).any()
    with pytest.raises(DataError, match="column 'sensor_std_m': got -1, expected a standard deviation from 0"):
        solved(world, {**table, "sensor_std_m": np.full(size, -1.0)}, "ml")


def test_headings_of_relative_bearings_are_errors_that_rows_share() -> None:
    """The std of a heading in the scene correlates the rows of a sensor, whether bearings are relative or not."""
    world = WORLDS["headings"]
    table, _, _ = sample(world, 4, seed=27)
    expected = solved(world, table, "ml")[1]
    scene = world.scene()
    turned = Scene(sensors=tuple(dataclasses.replace(sensor, heading_deg=90.0) for sensor in scene.sensors))
    relative = {**table, "relative_bearing_ccw_rad": table["bearing_rad"]}
    del relative["bearing_rad"]
    np.testing.assert_allclose(solved(world, relative, "ml", turned)[1], expected, rtol=1e-6)


def test_what_a_run_refuses() -> None:
    """One line each for standard deviations that are estimated, errors that are not Gaussian, and triplets."""
    world = WORLDS["places"]
    table, _, _ = sample(world, 3, seed=28)
    with pytest.raises(UsageError, match="`estimate_std` takes sensors and reflectors as exactly known"):
        nlosctl.localize(table, scene=world.scene(), estimate_std="file")
    with pytest.raises(UsageError, match="bound of laplace errors takes sensors and reflectors as exactly known"):
        nlosctl.bound(table, scene=world.scene(), noise="laplace")
    with pytest.raises(UsageError, match="triplets take sensors and reflectors as exactly known"):
        nlosctl.simulate("triplets", trials=3, scene=world.scene())
    triplets = nlosctl.simulate("triplets", trials=3)
    with pytest.raises(UsageError, match="triplets take s0, s1, s2 and 2 more as exactly known"):
        nlosctl.localize(triplets, scene=world.scene())
