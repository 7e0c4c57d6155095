"""Scenarios in three dimensions: their geometry, their errors, and what they leave out."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.scenarios.catalogue import scenarios


def drawn(name, snapshots=400, seed=1, **options):
    """Return the scenario's scene and columns, as blocks (B, K)."""
    spec = scenarios()[name]
    chosen = spec.options(**options)
    columns = spec.generate(chosen, np.random.default_rng(seed), snapshots)
    return spec.scene(chosen), {key: values.reshape(snapshots, -1) for key, values in columns.items()}


def vectors(columns):
    """Return the vectors (3, B, K) from the sensors to the true sources."""
    return np.stack([columns[f"truth_{axis}_m"] - columns[f"sensor_{axis}_m"] for axis in "xyz"])


def scaled_errors(columns, seen):
    """Return errors of azimuth and elevation over their stds, (2, B, K), against vectors as the sensors see them."""
    azimuth = np.angle(np.exp(1j * (columns["bearing_rad"] - np.arctan2(seen[1], seen[0]))))
    elevation = columns["elevation_rad"] - np.arctan2(seen[2], np.hypot(seen[0], seen[1]))
    return np.stack([azimuth / columns["bearing_std_rad"], elevation / columns["elevation_std_rad"]])


@pytest.mark.parametrize(
    ("name", "options"), [("space-ring", {}), ("street", {"direct_share": 1.0}), ("single-station", {})]
)
def test_direct_rows_have_gaussian_errors(name, options):
    """Azimuths and elevations differ from the direction of the source by Gaussian errors of their stds."""
    _, columns = drawn(name, **options)
    errors = scaled_errors(columns, vectors(columns))
    assert np.abs(errors.mean(axis=(1, 2))).max() < 4.0 / np.sqrt(errors[0].size)
    np.testing.assert_allclose(errors.std(axis=(1, 2)), 1.0, atol=0.1)
    assert columns["truth_los"].all()


def test_a_ring_has_rows_without_elevation_and_outliers():
    """The shares of rows of azimuth alone and of rows anywhere are those asked for."""
    _, columns = drawn("space-ring", azimuth_only=0.5, outlier_fraction=0.25)
    assert 0.45 < np.isnan(columns["elevation_rad"]).mean() < 0.55
    assert (np.isnan(columns["elevation_rad"]) == np.isnan(columns["elevation_std_rad"])).all()
    wrong = ~columns["truth_los"]
    assert 0.22 < wrong.mean() < 0.28
    elevation = columns["elevation_rad"][wrong & ~np.isnan(columns["elevation_rad"])]
    assert np.histogram(elevation, bins=4, range=(-np.pi / 2, np.pi / 2))[0].min() > 0.2 * elevation.size
    errors = scaled_errors(columns, vectors(columns))
    assert np.abs(errors[0][~wrong]).max() < 6.0


def test_a_street_has_images_by_facades_and_ground():
    """Rows that are not direct look at an image of the source in one of the facades or the ground."""
    _, columns = drawn("street", direct_share=0.0)
    assert not columns["truth_los"].any()
    assert "reflector" not in columns
    source = np.stack([columns[f"truth_{axis}_m"] for axis in "xyz"])
    sensor = np.stack([columns[f"sensor_{axis}_m"] for axis in "xyz"])
    x, y, z = source
    images = [np.stack([x, 24.0 - y, z]), np.stack([x, -24.0 - y, z]), np.stack([x, y, -z])]
    errors = np.stack([np.abs(scaled_errors(columns, image - sensor)).max(axis=0) for image in images])
    assert errors.min(axis=0).max() < 6.0
    shares = np.bincount(errors.argmin(axis=0).ravel(), minlength=3) / errors[0].size
    np.testing.assert_allclose(shares, 1.0 / 3.0, atol=0.05)


def test_stations_are_on_the_ground_and_see_the_ionosphere():
    """Stations are on the globe, sources above it, and the mean ray meets the ionosphere halfway to the source."""
    scene, columns = drawn("skywave")
    center, radius = np.array([0.0, 0.0, -6371e3]), 6671e3
    place = np.array([[*sensor.position, sensor.z_m] for sensor in scene.sensors])
    np.testing.assert_allclose(np.linalg.norm(place - center, axis=1), 6371e3)
    source = np.stack([columns[f"truth_{axis}_m"][:, 0] for axis in "xyz"], axis=1)
    height = np.linalg.norm(source - center, axis=1) - 6371e3
    assert height.min() >= 0.0
    assert height.max() <= 30e3
    exact = drawn("skywave", angle_std_deg=1e-9)[1]
    z, e = exact["bearing_rad"], exact["elevation_rad"]
    u = np.stack([np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)], axis=-1)
    start = place[None] - center
    along = np.sum(start * u, axis=-1)
    way = np.sqrt(along**2 + radius**2 - np.sum(start**2, axis=-1)) - along
    hit = start + way[..., None] * u
    normal = hit / radius
    back = u - 2.0 * np.sum(u * normal, axis=-1)[..., None] * normal
    truth = np.stack([exact[f"truth_{axis}_m"] for axis in "xyz"], axis=-1) - center
    left = truth - hit
    missed = np.linalg.norm(left - np.sum(left * back, axis=-1)[..., None] * back, axis=-1)
    assert missed.max() < 1.0
    assert (exact["reflector"] == "ionosphere").all()


def test_a_layer_makes_the_single_station_look_up():
    """By a flat layer the elevation is that of the image above it: distance (2 h - heights) / tan e."""
    _, columns = drawn("single-station", layer_height_m=300.0, angle_std_deg=1e-9)
    distance = np.hypot(columns["truth_x_m"], columns["truth_y_m"])
    np.testing.assert_allclose(distance * np.tan(columns["elevation_rad"]), 2 * 300.0 - 50.0 - 1.5, rtol=1e-6)
    errors = (columns["target_z_m"] - columns["truth_z_m"]) / columns["target_z_std_m"]
    assert abs(errors.std() - 1.0) < 0.1


def test_a_box_has_anchors_between_floor_and_ceiling():
    """Anchors are on the walls at two heights or in one plane; ranges are distances with Gaussian errors."""
    scene, columns = drawn("box", height_std_m=0.3)
    assert {sensor.z_m for sensor in scene.sensors} == {0.0, 6.0}
    assert all(max(map(abs, sensor.position)) == pytest.approx(10.0) for sensor in scene.sensors)
    errors = (columns["range_m"] - np.linalg.norm(vectors(columns), axis=0)) / columns["range_std_m"]
    assert abs(errors.std() - 1.0) < 0.05
    assert abs((columns["target_z_m"] - columns["truth_z_m"]).std() - 0.3) < 0.03
    flat, late = drawn("box", lowest_anchor_m=6.0, outlier_fraction=0.3)
    assert {sensor.z_m for sensor in flat.sensors} == {6.0}
    assert "target_z_m" not in late
    bias = late["range_m"] - np.linalg.norm(vectors(late), axis=0)
    assert 0.25 < (bias > 0.6).mean() < 0.33
