"""Simulations in the user's own scene: paths by brute force, truth recovered, heights, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector, Sensor
from nlosctl.errors import UsageError
from nlosctl.io.scenes.scene_file import scene_to_toml
from nlosctl.scenarios.madhow_walls import trace_paths

SENSORS = tuple(Sensor(name=n, position=p) for n, p in (("a", (0.0, 0.0)), ("b", (90.0, 5.0)), ("c", (40.0, 75.0))))
WALLS = (
    SegmentReflector(name="west", start=(-20.0, 40.0), end=(20.0, 90.0)),
    SegmentReflector(name="east", start=(60.0, 20.0), end=(110.0, 60.0)),
)
MIRROR = LineReflector(name="floor", point=(0.0, -30.0), direction=(1.0, 0.0))


def rows_of(table: Any) -> list[dict[str, Any]]:
    """Return the rows of a table."""
    return list(table.to_pylist())


def test_walls_block_and_reflect_as_traced_paths() -> None:
    """Among walls the rows are the paths of a ray tracer, row by row, with their bearings and lengths."""
    scene = Scene(sensors=SENSORS, reflectors=WALLS)
    keywords = {"scene": scene, "trials": 200, "seed": 2, "region": "-40,120,-40,120"}
    bearings = rows_of(nlosctl.simulate("bearings", bearing_std_deg=1e-9, **keywords))
    ranges = rows_of(nlosctl.simulate("ranges", range_std_m=1e-9, **keywords))
    targets = {row["snapshot"]: (row["truth_x_m"], row["truth_y_m"]) for row in bearings}
    found, lengths = {}, {}
    for row in bearings:
        found[row["snapshot"], row["sensor"], row["reflector"]] = row["bearing_rad"]
    for row in ranges:
        lengths[row["snapshot"], row["sensor"], row["reflector"]] = row["range_m"]
    expected = {}
    for snapshot, target in targets.items():
        for sensor in SENSORS:
            for path in trace_paths(target, sensor.position, WALLS):
                expected[snapshot, sensor.name, path.wall] = path
    assert {wall for *_, wall in expected} == {None, "west", "east"}
    assert found.keys() == expected.keys() == lengths.keys()
    for key, path in expected.items():
        assert np.cos(found[key] - path.bearing_rad) == pytest.approx(1.0, abs=1e-12)
        assert lengths[key] == pytest.approx(path.length_m, abs=1e-6)


def test_a_mirror_reflects_on_the_side_of_the_sensor() -> None:
    """A line mirror has rows for targets on the side of the sensor: the length is the distance to the mirror image."""
    scene = Scene(sensors=SENSORS, reflectors=(MIRROR,))
    rows = rows_of(nlosctl.simulate("ranges", scene=scene, trials=300, region="circle:0,-30,60", range_std_m=1e-9))
    assert {row["truth_y_m"] > -30.0 for row in rows} == {True, False}
    for row in rows:
        x, y = row["sensor_x_m"], row["sensor_y_m"]
        if row["reflector"] is not None:
            assert row["truth_y_m"] > -30.0
            y = -60.0 - y
        assert row["range_m"] == pytest.approx(np.hypot(row["truth_x_m"] - x, row["truth_y_m"] - y), abs=1e-6)


def test_no_path_crosses_the_blocker_of_a_circle() -> None:
    """Rows by a circle reflect at equal angles within it, and no leg, nor a direct path, passes its blocker."""
    circle = CircleReflector(name="layer", center=(0.0, 0.0), radius=100.0, blocker_radius=40.0)
    sensors = (*(Sensor(name=s, position=p) for s, p in (("a", (0.0, 60.0)), ("b", (-45.0, 30.0)))),)
    outside = Sensor(name="far", position=(200.0, 0.0))
    scene = Scene(sensors=(*sensors, outside), reflectors=(circle,))
    rows = rows_of(nlosctl.simulate("bearings", scene=scene, trials=300, region="circle:0,0,95", bearing_std_deg=1e-9))
    assert not [row for row in rows if row["sensor"] == "far" and row["reflector"] == "layer"]
    for row in rows:
        start = np.array([row["sensor_x_m"], row["sensor_y_m"]])
        end = np.array([row["truth_x_m"], row["truth_y_m"]])
        legs = [(start, end)]
        if row["reflector"] == "layer":
            ray = np.array([np.cos(row["bearing_rad"]), np.sin(row["bearing_rad"])])
            along = -start @ ray + np.sqrt((start @ ray) ** 2 - start @ start + 100.0**2)
            hit = start + along * ray
            legs = [(start, hit), (hit, end)]
            cosines = [abs((point - hit) @ hit) / np.linalg.norm(point - hit) / 100.0 for point in (start, end)]
            assert cosines[0] == pytest.approx(cosines[1], abs=1e-6)
        shares = np.linspace(0.0, 1.0, 400)[:, None]
        for first, second in legs:
            assert np.hypot(*(first + shares * (second - first)).T).min() > 40.0 - 1e-3
    assert {row["reflector"] for row in rows} == {None, "layer"}


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_the_errors_are_those_of_the_covariances(kind: str) -> None:
    """Fixes of direct rows have a mean NEES of 2; a fixed target is where it was put."""
    std = {"bearings": {"bearing_std_deg": 0.5}, "ranges": {"range_std_m": 0.2}}[kind]
    table = nlosctl.simulate(kind, scene=Scene(sensors=SENSORS), trials=2000, seed=5, target=(30.0, 20.0), **std)
    assert set(table["truth_x_m"].to_pylist()) == {30.0}
    scores = nlosctl.evaluate(nlosctl.localize(table).estimates).groups[0]
    assert scores["nees_low"] < 2.05
    assert scores["nees_high"] > 1.95


def test_heights_of_the_scene() -> None:
    """With heights the ranges are slant, the column is written, and ``target_z_m`` finds the target."""
    sensors = tuple(Sensor(name=s.name, position=s.position, z_m=4.0 + i) for i, s in enumerate(SENSORS))
    keywords = {"trials": 50, "target": (30.0, 20.0), "target_z_m": 1.5, "range_std_m": 1e-6}
    table = nlosctl.simulate("ranges", scene=Scene(sensors=sensors), **keywords)
    first = rows_of(table)[0]
    assert first["range_m"] == pytest.approx(np.sqrt(30.0**2 + 20.0**2 + 2.5**2), abs=1e-4)
    estimates = nlosctl.localize(table.drop_columns(["sensor_z_m"]), target_z_m=1.5).estimates  # from the metadata
    assert estimates["x_m"].to_pylist() == pytest.approx([30.0] * 50, abs=1e-3)


def test_the_command_takes_a_file(tmp_path: Path) -> None:
    """``simulate --scene FILE`` equals the function, bearings by default; impossible requests are usage errors."""
    scene = Scene(sensors=SENSORS, reflectors=(*WALLS, MIRROR))
    (tmp_path / "s.toml").write_text(scene_to_toml(scene))
    done = run_here(
        "simulate", "--scene", "s.toml", "-n", "50", "--seed", "3", "-q", "-o", "b.parquet", folder=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert nlosctl.read(tmp_path / "b.parquet").equals(
        nlosctl.simulate("bearings", scene=tmp_path / "s.toml", trials=50, seed=3)
    )
    for words, message in (
        (["ring", "--scene", "s.toml"], "scenario 'ring' has a scene of its own"),
        (["--scene", "s.toml", "-p", "region=nowhere"], "field 'nowhere'"),
        (["--scene", "s.toml", "-p", "sensors=3"], "has no parameter 'sensors'"),
    ):
        refused = run_here("simulate", *words, folder=tmp_path)
        assert (refused.returncode, message in refused.stderr.decode()) == (2, True), refused.stderr
    with pytest.raises(UsageError, match="has no sensors"):
        nlosctl.simulate("bearings", scene=Scene(reflectors=(MIRROR,)))


def _images(point: tuple[float, float]) -> dict[str | None, np.ndarray]:
    """A point, and its images in the floor y = 0 and in the wall x = 0."""
    x, y = point
    return {None: np.array([x, y]), "floor": np.array([x, -y]), "wall": np.array([-x, y])}


def test_triplets_are_those_of_the_image_method(tmp_path: Path) -> None:
    """Between two mirrors each pair of legs has a row, with the angles and the length of the images of the target."""
    mirrors = (
        LineReflector(name="floor", point=(0.0, 0.0), direction=(1.0, 0.0)),
        LineReflector(name="wall", point=(0.0, 0.0), direction=(0.0, 1.0)),
    )
    nodes = {"t": (2.0, 3.0), "r1": (9.0, 2.0), "r2": (4.0, 7.0)}
    scene = Scene(sensors=tuple(Sensor(name=n, position=p) for n, p in nodes.items()), reflectors=mirrors)
    precise = {"angle_std_deg": 1e-9, "path_length_std_m": 1e-9}
    keywords = {"scene": scene, "trials": 20, "region": "1,10,1,8", **precise}
    rows = rows_of(nlosctl.simulate("triplets", **keywords))
    assert len(rows) == 20 * 2 * 9
    for snapshot in range(20):
        mine = [row for row in rows if row["snapshot"] == snapshot]
        assert [row["path"] for row in mine] == list(range(18))
        target = (mine[0]["truth_x_m"], mine[0]["truth_y_m"])
        expected = []
        for name in ("r1", "r2"):
            for first, out in _images(target).items():
                for second, back in _images(target).items():
                    to, fro = out - nodes["t"], back - nodes[name]
                    angles = (np.arctan2(to[1], to[0]), np.arctan2(fro[1], fro[0]))
                    indirect = first is not None or second is not None
                    expected.append([*nodes[name], *angles, np.hypot(*to) + np.hypot(*fro), indirect])
        names = ("rx_x_m", "rx_y_m", "dod_rad", "doa_rad", "path_length_m", "truth_ip")
        found = [[float(row[name]) for name in names] for row in mine]
        found, expected = (sorted(rows, key=lambda row: np.round(row, 4).tolist()) for rows in (found, expected))
        np.testing.assert_allclose(found, expected, atol=1e-6)
    only = rows_of(nlosctl.simulate("triplets", direct=False, transmitters=["r1"], receivers=["t"], **keywords))
    assert {(row["tx_x_m"], row["rx_x_m"], row["truth_ip"]) for row in only} == {(9.0, 2.0, True)}
    assert len(only) == 20 * 8


def test_walls_block_legs_of_triplets() -> None:
    """A wall between the transmitter and the target leaves no path whose first leg is straight."""
    wall = SegmentReflector(name="wall", start=(5.0, -10.0), end=(5.0, 10.0))
    scene = Scene(
        sensors=(Sensor(name="t", position=(0.0, 0.0)), Sensor(name="r", position=(9.0, 4.0))), reflectors=(wall,)
    )
    rows = rows_of(nlosctl.simulate("triplets", scene=scene, target=[8.0, 1.0], trials=3))
    assert rows == []
    rows = rows_of(nlosctl.simulate("triplets", scene=scene, target=[4.0, 1.0], trials=3))
    assert {row["truth_ip"] for row in rows} <= {True}


def test_triplets_of_an_unsuitable_scene() -> None:
    """Unknown names and a lone sensor are refused in words."""
    two = (Sensor(name="t", position=(0.0, 0.0)), Sensor(name="r", position=(9.0, 4.0)))
    for sensors, words, message in (
        (two, {"transmitters": ["x"]}, "the scene has no sensor 'x'"),
        (two[:1], {}, "no sensor that receives"),
    ):
        with pytest.raises(UsageError, match=message):
            nlosctl.simulate("triplets", scene=Scene(sensors=sensors), trials=1, **words)
