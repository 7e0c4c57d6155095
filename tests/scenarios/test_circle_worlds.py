"""Scenarios with circles: tables of the paper, physical paths."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.errors import UsageError
from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.geometry.visibility import sees_by_reflection, sees_directly
from nlosctl.scenarios.catalogue import find_scenario

WORLDS = [
    ("song-circle", {"parameter_set": "a"}),
    ("song-circle", {"parameter_set": "b"}),
    ("over-the-horizon", {}),
    ("over-the-horizon", {"min_elevation_deg": 4.0, "sensors": 3, "baseline_m": 900e3}),
    ("over-the-horizon", {"sensors": 1, "far_layer_fraction": 0.0}),
    ("mixed", {}),
]


def generate(name, snapshots, options):
    """Return scene and columns of one call."""
    spec = find_scenario(name)
    chosen = spec.options(**options)
    return spec.scene(chosen), spec.generate(chosen, np.random.default_rng(5), snapshots)


def rows_of(columns, name):
    """Return which rows are by the reflector, or direct rows for None."""
    return np.array([found == name for found in columns.get("reflector", [None] * len(columns["snapshot"]))])


@pytest.mark.parametrize(("name", "options"), WORLDS)
def test_paths_are_clear_and_bearings_agree(name, options):
    """Circle rows have a clear path above the least elevation, with a bearing within five sigma."""
    scene, columns = generate(name, 400, {**options, "bearing_std_deg": 0.5})
    seen = 0
    for circle in [reflector for reflector in scene.reflectors if hasattr(reflector, "radius")]:
        rows = rows_of(columns, circle.name)
        if not rows.any():
            continue
        x, y = (columns[f"sensor_{axis}_m"][rows] - circle.center[i] for i, axis in enumerate("xy"))
        tx, ty = (columns[f"truth_{axis}_m"][rows] - circle.center[i] for i, axis in enumerate("xy"))
        radius = np.full(x.shape, circle.radius)
        paths = all_reflections(x, y, tx, ty, radius)
        least = np.full(x.shape, np.radians(circle.min_elevation_deg or 0.0) - 1e-9)
        free = sees_by_reflection(x, y, tx, ty, paths, radius, np.full(x.shape, circle.blocker_radius), least)
        assert (free.sum(axis=0) == 1).all()
        path = np.where(free, paths.bearing_rad, 0.0).sum(axis=0)
        off = np.angle(np.exp(1j * (columns["bearing_rad"][rows] - path)))
        assert np.abs(off).max() < 5.0 * np.radians(0.5)
        assert np.std(off) == pytest.approx(np.radians(0.5), rel=0.2)
        seen += rows.sum()
    assert seen > 0


def test_sensor_sets_agree_with_tables_3_and_4():
    """Tables III and IV: polar coordinates of the sensors, the target 50 km up."""
    for letter, expected in (("a", (0.10, 0.08, -0.09, -0.06)), ("b", (0.11, -0.07, -0.12))):
        scene, columns = generate("song-circle", 1, {"parameter_set": letter})
        position = np.array([complex(*sensor.position) for sensor in scene.sensors])
        np.testing.assert_allclose(np.abs(position), 6371e3, rtol=1e-14)
        np.testing.assert_allclose(np.angle(position) / np.pi, expected, atol=1e-15)
        assert (columns["truth_x_m"] == 6421e3).all()
        assert (columns["truth_y_m"] == 0.0).all()
        assert (scene.reflectors[0].radius, scene.reflectors[0].blocker_radius) == (6671e3, 6371e3)


def test_both_layers_are_received():
    """Near sources come by the E layer too, with the requested fraction of rows by the F layer."""
    _, columns = generate("over-the-horizon", 500, {})
    assert 0.05 < rows_of(columns, "E").mean() < 0.5
    _, columns = generate("over-the-horizon", 500, {"far_layer_fraction": 1.0})
    assert rows_of(columns, "F").all()


def test_mixed_paths_have_the_requested_fractions():
    """Direct, mirror and circle rows have their fractions; direct rows have a clear line of sight."""
    scene, columns = generate("mixed", 2000, {"shares": (0.5, 0.2, 0.3)})
    shares = [rows_of(columns, name).mean() for name in (None, "cliff", "layer")]
    np.testing.assert_allclose(shares, (0.5, 0.2, 0.3), atol=0.02)
    direct, layer = rows_of(columns, None), scene.reflectors[1]
    x, y = (columns[f"sensor_{axis}_m"][direct] - layer.center[i] for i, axis in enumerate("xy"))
    tx, ty = (columns[f"truth_{axis}_m"][direct] - layer.center[i] for i, axis in enumerate("xy"))
    assert sees_directly(x, y, tx, ty, np.full(x.shape, layer.blocker_radius), np.full(x.shape, -np.inf)).all()
    cliff = scene.reflectors[0]
    normal = np.array([-cliff.direction[1], cliff.direction[0]])
    for axis in ("sensor", "truth"):
        points = np.stack([columns[f"{axis}_x_m"], columns[f"{axis}_y_m"]], axis=1)
        assert ((points - np.array(cliff.point)) @ normal > 0.0).all()


def test_impossible_layouts_are_refused():
    """Sensors too far apart for one source, and sources above the layers, are errors."""
    with pytest.raises(UsageError, match="baseline_m"):
        generate("over-the-horizon", 10, {"baseline_m": 9000e3})
    with pytest.raises(UsageError, match="layer_heights_m"):
        generate("over-the-horizon", 10, {"source_heights_m": (1e3, 200e3)})
