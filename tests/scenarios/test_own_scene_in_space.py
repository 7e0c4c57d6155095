"""Simulations in the user's own scene in space: paths by brute force, calibrated errors, heights, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.scene import (
    CircleReflector,
    LineReflector,
    PlaneReflector,
    Scene,
    SegmentReflector,
    Sensor,
    SphereReflector,
)
from nlosctl.errors import UsageError
from nlosctl.io.scenes.scene_file import scene_to_toml

Array = np.ndarray

SENSORS = tuple(
    Sensor(name=f"s{number}", position=(x, y), z_m=z)
    for number, (x, y, z) in enumerate([(0.0, 0.0, 3.0), (40.0, 2.0, 12.0), (38.0, 35.0, 5.0), (-3.0, 42.0, 18.0)])
)
WALLS = (
    SegmentReflector(name="inner", start=(15.0, 5.0), end=(15.0, 30.0)),
    SegmentReflector(name="outer", start=(60.0, -30.0), end=(60.0, 80.0)),
)
PLANES = (
    PlaneReflector(name="floor", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
    PlaneReflector(name="roof", point=(0.0, -20.0, 30.0), normal=(0.1, 0.3, -2.0)),
    LineReflector(name="line", point=(0.0, 90.0), direction=(1.0, 0.1)),
)
STREET = Scene(sensors=SENSORS, reflectors=(*WALLS, *PLANES))
REGION = "0,40,0,40,1,15"
R = 6371e3
GLOBE = Scene(
    sensors=tuple(
        Sensor(name=name, position=(x, y), z_m=float(np.sqrt(R * R - x * x - y * y) - R))
        for name, x, y in (("a", -2e5, 0.0), ("b", 1e5, 2e5), ("c", 1e5, -2e5))
    ),
    reflectors=(SphereReflector(name="F", center=(0.0, 0.0, -R), radius=R + 3e5, blocker_radius=R),),
)


def rows_of(table: Any) -> list[dict[str, Any]]:
    """Return the rows of a table."""
    return list(table.to_pylist())


def place(row: dict[str, Any], name: str) -> Array:
    """Return the three coordinates of a point of a row."""
    return np.array([row[f"{name}_{axis}_m"] for axis in "xyz"])


def plane_of(mirror: Any) -> tuple[Array, Array]:
    """Return a point and the unit normal of a plane mirror or wall."""
    if isinstance(mirror, PlaneReflector):
        return np.array(mirror.point), np.array(mirror.normal) / np.linalg.norm(mirror.normal)
    normal = np.array([-mirror.direction[1], mirror.direction[0], 0.0])
    return np.array([*mirror.point, 0.0]), normal / np.linalg.norm(normal)


def meets(wall: SegmentReflector, start: Array, end: Array) -> bool:
    """Return whether a leg passes through a vertical wall of any height between its ends."""
    point, normal = plane_of(wall)
    sides = (start - point) @ normal, (end - point) @ normal
    if sides[0] * sides[1] >= 0.0:
        return False
    hit = start + sides[0] / (sides[0] - sides[1]) * (end - start)
    along = np.array([*wall.direction, 0.0])
    return bool(0.0 <= (hit - point) @ along <= along @ along)


def traced(target: Array, sensor: Array) -> dict[str | None, Array]:
    """Return the vector that the sensor sees, as long as the path, of every path that exists in `STREET`."""
    found: dict[str | None, Array] = {}
    if not any(meets(wall, sensor, target) for wall in WALLS):
        found[None] = target - sensor
    for mirror in STREET.reflectors:
        point, normal = plane_of(mirror)
        near, far = (sensor - point) @ normal, (target - point) @ normal
        if near * far <= 0.0:
            continue
        image = target - 2.0 * far * normal
        hit = sensor + near / (near + far) * (image - sensor)
        if isinstance(mirror, SegmentReflector) and not meets(mirror, sensor, image):
            continue
        others = [wall for wall in WALLS if wall is not mirror]
        if not any(meets(wall, sensor, hit) or meets(wall, hit, target) for wall in others):
            found[mirror.name] = image - sensor
    return found


def test_rows_are_the_traced_paths() -> None:
    """Rows are the paths of a ray tracer, with azimuth, elevation and length; arrivals are those of the first."""
    keywords = {"scene": STREET, "trials": 150, "seed": 2, "region": "-20,70,-40,80,1,25"}
    bearings = rows_of(nlosctl.simulate("bearings", bearing_std_deg=1e-9, **keywords))
    ranges = rows_of(nlosctl.simulate("ranges", range_std_m=1e-9, **keywords))
    arrivals = rows_of(nlosctl.simulate("arrivals", arrival_std_m=1e-9, offset_m=0.0, **keywords))
    targets = {row["snapshot"]: place(row, "truth") for row in bearings}
    expected = {
        (snapshot, sensor.name): traced(target, np.array([*sensor.position, sensor.z_m]))
        for snapshot, target in targets.items()
        for sensor in SENSORS
    }
    assert {by for paths in expected.values() for by in paths} == {None, *STREET.reflector_names}
    every = {(*key, by): vector for key, paths in expected.items() for by, vector in paths.items()}
    assert {(row["snapshot"], row["sensor"], row["reflector"]) for row in bearings} == every.keys()
    assert len(bearings) == len(ranges) == len(every)
    for row in bearings:
        e, z = row["elevation_rad"], row["bearing_rad"]
        vector = every[row["snapshot"], row["sensor"], row["reflector"]]
        ray = [np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)]
        np.testing.assert_allclose(ray, vector / np.linalg.norm(vector), atol=1e-9)
    for row in ranges:
        vector = every[row["snapshot"], row["sensor"], row["reflector"]]
        assert row["range_m"] == pytest.approx(np.linalg.norm(vector), abs=1e-6)
    first = {
        key: min((np.linalg.norm(v), by is None) for by, v in paths.items()) for key, paths in expected.items() if paths
    }
    assert {(row["snapshot"], row["sensor"]) for row in arrivals} == first.keys()
    for row in arrivals:
        length, direct = first[row["snapshot"], row["sensor"]]
        assert (row["arrival_m"], row["truth_los"]) == (pytest.approx(length, abs=1e-6), direct)


def test_paths_by_a_sphere_reflect_at_equal_angles_above_the_globe() -> None:
    """Rows by a sphere leave it at the angle of incidence, in one plane, and no leg enters the opaque globe."""
    keywords = {"scene": GLOBE, "trials": 20, "seed": 1, "region": "-3e5,3e5,-3e5,3e5,8e3,2e4"}
    bearings = rows_of(nlosctl.simulate("bearings", bearing_std_deg=1e-9, **keywords))
    ranges = rows_of(nlosctl.simulate("ranges", range_std_m=1e-6, **keywords))
    assert {row["reflector"] for row in bearings} >= {"F"}
    center = np.array([0.0, 0.0, -R])
    for row, length in zip(bearings, ranges, strict=True):
        start, end = place(row, "sensor") - center, place(row, "truth") - center
        z, e = row["bearing_rad"], row["elevation_rad"]
        ray = np.array([np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)])
        legs = [(start, end)]
        if row["reflector"] == "F":
            along = -start @ ray + np.sqrt((start @ ray) ** 2 - start @ start + (R + 3e5) ** 2)
            hit = start + along * ray
            up = hit / np.linalg.norm(hit)
            back = ray - 2.0 * (ray @ up) * up
            assert np.linalg.norm((end - hit) / np.linalg.norm(end - hit) - back) < 1e-6
            legs = [(start, hit), (hit, end)]
        assert length["range_m"] == pytest.approx(sum(np.linalg.norm(b - a) for a, b in legs), abs=1e-3)
        for first, second in legs:
            way = first + np.linspace(0.0, 1.0, 500)[:, None] * (second - first)
            assert np.linalg.norm(way, axis=1).min() > R - 1e-3


CALIBRATED = {
    "bearings": {"scene": STREET, "bearing_std_deg": 0.5, "elevation_std_deg": 1.0, "azimuth_only": 0.3},
    "bearings by a sphere": {"scene": GLOBE, "bearing_std_deg": 0.2, "target": (5e4, 3e4, 1e4)},
    "ranges": {"scene": STREET, "range_std_m": 0.05},
    "triplets": {"scene": Scene(sensors=SENSORS), "elevation_std_deg": 0.7},
    "arrivals": {"scene": Scene(sensors=(*SENSORS, Sensor(name="s4", position=(20.0, 20.0), z_m=25.0)))},
    "arrivals in the plane": {
        "scene": Scene(sensors=tuple(Sensor(name=s.name, position=s.position) for s in SENSORS)),
        "region": "0,40,0,40",
    },
}


@pytest.mark.parametrize(
    "snapshots", [pytest.param(400, id="few"), pytest.param(4000, marks=[pytest.mark.slow, pytest.mark.extensive])]
)
@pytest.mark.parametrize("case", CALIBRATED)
def test_the_errors_are_those_of_the_covariances(case: str, snapshots: int) -> None:
    """Fixes of simulated rows have a mean NEES of the number of unknowns, and nearly all have a covariance."""
    kind = case.split(maxsplit=1)[0]
    options = {"region": REGION, **CALIBRATED[case]}
    if kind == "arrivals":
        options["arrival_std_m"] = 0.05
    scene = options.pop("scene")
    table = nlosctl.simulate(kind, scene=scene, trials=snapshots, seed=5, **options)
    unknowns = 3 if scene.has_heights else 2
    estimates = nlosctl.localize(table, method="ml", dimensions=unknowns).estimates
    scores = nlosctl.evaluate(estimates).groups[0]
    assert scores["nees_low"] < 1.03 * unknowns
    assert scores["nees_high"] > 0.97 * unknowns
    assert np.isfinite(np.array(estimates["cov_xx_m2"].to_pylist(), dtype=float)).mean() > 0.9


def test_heights_of_targets() -> None:
    """A height is the third number of the target, the region's, or ``target_z_m``, by default 0."""

    def heights(**options: Any) -> set[float]:
        table = nlosctl.simulate("ranges", scene=Scene(sensors=SENSORS), trials=50, **options)
        return set(table["truth_z_m"].to_pylist())

    assert heights(target=(1.0, 2.0, 3.0)) == {3.0}
    assert heights(target=(1.0, 2.0), target_z_m=4.0) == {4.0}
    assert heights(region="0,9,0,9", target_z_m=4.0) == {4.0}
    assert heights() == {0.0}
    random = heights(region="0,9,0,9,5,6")
    assert len(random) == 50
    assert (5.0 <= min(random) < 5.2) & (5.8 < max(random) <= 6.0)


def test_elevations_past_the_zenith_are_those_of_the_opposite_azimuth() -> None:
    """A source above the sensor has elevations of at most 90 degrees, with azimuths on all sides."""
    above = {"target": (0.1, 0.0, 30.0), "bearing_std_deg": 1e-6, "elevation_std_deg": 2.0}
    rows = rows_of(nlosctl.simulate("bearings", scene=Scene(sensors=SENSORS[:1]), trials=200, **above))
    elevation = np.array([row["elevation_rad"] for row in rows])
    assert elevation.max() <= 0.5 * np.pi
    turned = np.cos([row["bearing_rad"] for row in rows]) < 0.0
    assert 0.3 < turned.mean() < 0.6
    swung = np.where(turned, np.pi - elevation, elevation) - np.arctan2(27.0, 0.1)
    assert np.std(swung) == pytest.approx(np.radians(2.0), rel=0.15)


def test_requests_that_do_not_fit_the_dimension() -> None:
    """Reflectors and parameters of the other dimension are refused in words."""
    flat = Scene(sensors=tuple(Sensor(name=s.name, position=s.position) for s in SENSORS))
    circle = CircleReflector(name="c", center=(0.0, 0.0), radius=1e3)
    for kind, scene, words, message in (
        ("bearings", Scene(sensors=SENSORS, reflectors=(circle,)), {}, "reflector 'c' is a circle, of two dimensions"),
        ("ranges", Scene(sensors=flat.sensors, reflectors=PLANES), {}, "reflector 'floor' is a plane, of three"),
        ("bearings", flat, {"elevation_std_deg": 2.0}, "elevation_std_deg: has heights or elevations"),
        ("bearings", flat, {"azimuth_only": 0.5}, "azimuth_only: has heights or elevations"),
        ("arrivals", flat, {"target": (1.0, 2.0, 3.0)}, "target: has heights or elevations"),
        ("triplets", flat, {"region": REGION}, "region: has heights or elevations"),
        ("ranges", flat, {"target_z_m": 1.0}, "target_z_m: has heights or elevations"),
        ("ranges", STREET, {"region": REGION, "target_z_m": 1.0}, "target_z_m and region both have heights"),
        ("ranges", STREET, {"target": (1.0,)}, "'target' parameter must be x,y or x,y,z"),
    ):
        with pytest.raises(UsageError, match=message):
            nlosctl.simulate(kind, scene=scene, trials=1, **words)


def test_the_command_takes_a_scene_in_space(tmp_path: Path) -> None:
    """``simulate KIND --scene FILE`` equals the function, ``--show`` lists the parameters of arrivals in a scene."""
    (tmp_path / "s.toml").write_text(scene_to_toml(STREET))
    for kind in ("bearings", "ranges", "triplets", "arrivals"):
        words = (
            "simulate",
            kind,
            "--scene",
            "s.toml",
            "-n",
            "5",
            "-p",
            f"region={REGION}",
            "-q",
            "-o",
            f"{kind}.parquet",
        )
        done = run_here(*words, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        same = nlosctl.simulate(kind, scene=tmp_path / "s.toml", trials=5, region=REGION)
        assert nlosctl.read(tmp_path / f"{kind}.parquet").equals(same)
    shown = run_here("simulate", "arrivals", "--scene", "s.toml", "--show", folder=tmp_path).stdout.decode()
    assert "detection_probability" in shown
    assert "radius_m" not in shown
