"""The user's own scene, in the plane or in space: its targets, and every path by which a sensor can receive them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from math import dist
from typing import Any, ClassVar, Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField, parse_field
from nlosctl.contract.options import option
from nlosctl.contract.scene import CircleReflector, PlaneReflector, Scene, SegmentReflector, Sensor, SphereReflector
from nlosctl.errors import UsageError
from nlosctl.geometry.directions import Vector, azimuth_elevation, length
from nlosctl.geometry.lines import crosses_segment
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.models.search_regions import search_region
from nlosctl.models.space.paths import predict_path_vectors
from nlosctl.models.space.plane_mirrors import gather_plane_mirrors
from nlosctl.models.space.rays import space_lines
from nlosctl.scenarios.space_rows import in_table_order
from nlosctl.scenarios.spec import Columns, ScenarioSpec
from nlosctl.scenarios.true_worlds import generate_in_worlds

__all__ = ["SQUARE", "SceneOptions", "ScenePaths", "row_columns", "scenario_in_scene", "scene_paths"]

SQUARE = Scene(
    sensors=tuple(
        Sensor(name=f"s{number}", position=position)
        for number, position in enumerate([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)], 1)
    )
)
"""The scene without one of the user's own."""

_DRAWS = 1000


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Parameters of the scenarios with the user's own scene. Those ``OF_SPACE`` are for sensors with heights."""

    OF_SPACE: ClassVar[tuple[str, ...]] = ("target_z_m",)

    target: tuple[float, ...] | None = option(
        None, unit="m", meaning="fixed position x,y or x,y,z of the target; default: random in the region"
    )
    region: str = option(
        "sensors:0.5", meaning="region of random targets, as for --field; default: around the sensors of the scene"
    )
    target_z_m: float | None = option(
        None, unit="m", meaning="height of the target, if neither target nor region has one; default: 0"
    )
    direct: bool = option(True, meaning="whether there are rows of the direct path, where no wall or circle is in it")
    reflected: bool = option(True, meaning="whether there are rows by the reflectors, where the path exists")
    detection_probability: float = option(
        1.0, minimum=0.0, maximum=1.0, meaning="probability that a row is there, if its path exists"
    )
    worlds: Literal["snapshot", "file"] = option(
        "snapshot",
        meaning="errors of a scene that is not exactly known: new ones in each snapshot, or the same in the whole file",
    )

    def __post_init__(self) -> None:
        parse_field(self.region)
        if self.target is not None and len(self.target) not in (2, 3):
            raise UsageError(f"The 'target' parameter must be x,y or x,y,z. Got {self.target!r} instead.")


def scenario_in_scene(*, name: str, options: type[SceneOptions], generate: Callable[..., Columns]) -> ScenarioSpec:
    """Return the scenario of the kind ``name`` in `SQUARE`, or in a scene of the user's own: ``generate(scene=)``."""

    def of_scene(own: Scene) -> ScenarioSpec:
        mine = partial(generate, scene=own)
        if own.is_uncertain:
            mine = partial(generate_in_worlds, generate=generate, scene=own)
        summary = f"{name} in your own scene"
        return replace(spec, summary=summary, scene=lambda _: own, generate=mine, one_by_one=own.is_uncertain)

    spec = ScenarioSpec(
        name=name,
        kind=name,
        summary=f"{name} in a scene of your own (--scene FILE), else in a square of four sensors: all paths that exist",
        reference="generic",
        options=options,
        scene=lambda options: SQUARE,
        generate=partial(generate, scene=SQUARE),
        of_scene=of_scene,
    )
    return spec


@dataclass(frozen=True)
class ScenePaths:
    """Paths of B snapshots by K ways each, in the plane (D = 2), or in space (3) if the sensors have heights.

    Sensor and reflector of each way (K,), -1 for the direct path; positions of sensors (B, K, D) and targets (B, D);
    bearings, elevations (None in the plane) and lengths of the paths at the sensor (B, K), and which exist.
    """

    scene: Scene
    sensor: IntArray
    reflector: IntArray
    sensor_m: FloatArray
    target_m: FloatArray
    bearing_rad: FloatArray
    elevation_rad: FloatArray | None
    length_m: FloatArray
    exists: BoolArray


def scene_paths(options: SceneOptions, scene: Scene, generator: np.random.Generator, snapshots: int) -> ScenePaths:
    """Sample a target for each snapshot, and find all paths to the sensors; raises UsageError without sensors.

    A wall (segment) hides what is behind it from every path, lines and planes reflect on the side of the sensor, and
    circles, spheres and their blockers limit paths as `nlosctl.models.obstacles` describes.
    """
    if not scene.sensors:
        raise UsageError("`scene` has no sensors; add a table [[sensor]] with name and position for each")
    _check_dimension(options, scene)
    sensors = scene.stationary_sensors("the simulation").values()
    positions = np.array(
        [sensor.position if sensor.z_m is None else (*sensor.position, sensor.z_m) for sensor in sensors]
    )
    reflectors = [*([-1] if options.direct else []), *(range(len(scene.reflectors)) if options.reflected else [])]
    ways = [(s, r) for s in range(len(positions)) for r in reflectors if _is_inside(scene, positions[s], r)]
    if not ways:
        raise UsageError("the scene has no path: set `parameters` direct=true, or add reflectors")
    way_sensor, way_reflector = np.array(ways, dtype=np.int64).T
    target = _targets(options, positions, generator, snapshots)
    shape = (snapshots, len(ways))
    dimension = positions.shape[1]
    sensor = np.broadcast_to(positions[way_sensor], (*shape, dimension))
    reflector = np.broadcast_to(way_reflector, shape)
    whole = np.broadcast_to(target[:, None], (*shape, dimension))
    bearing, elevation, path_m = _predict_paths(sensor, whole, reflector, scene)
    space: dict[str, Any] = {}
    if elevation is not None:
        level = np.nan_to_num(elevation)
        space = {"sensor_z_m": sensor[..., 2], "elevation_rad": level, "elevation_std_rad": np.ones(shape)}
    batch = BearingBatch(
        scene=scene,
        seed=np.zeros(snapshots, dtype=np.uint64),
        dimension=dimension,
        sensor=np.broadcast_to(way_sensor, shape),
        sensor_xy_m=sensor[..., :2],
        bearing_rad=np.nan_to_num(bearing),
        bearing_std_rad=np.ones(shape),
        path=np.zeros(shape, dtype=np.int64),
        reflector=reflector,
        **space,
    )
    lines: Any = sight_lines(batch) if elevation is None else space_lines(batch)
    unseen = lines.unseen(*(target[:, axis] - middle for axis, middle in enumerate(lines.center)))
    drawn = generator.random(shape) < options.detection_probability
    exists = ~unseen & np.isfinite(bearing) & ~_is_blocked(scene, _axes(sensor), reflector, _axes(target)) & drawn
    return ScenePaths(scene, way_sensor, way_reflector, sensor, target, bearing, elevation, path_m, exists)


def row_columns(kind: str, paths: ScenePaths, values: Columns) -> Columns:
    """Return the columns of a file of a kind: ``values`` (B, K) and those of the paths, in rows where a path exists."""
    snapshot, way = np.nonzero(paths.exists)
    names = np.array([sensor.name for sensor in paths.scene.sensors], dtype=object)
    by = {}
    if paths.scene.reflectors:
        by["reflector"] = np.array([*paths.scene.reflector_names, None], dtype=object)[paths.reflector[way]]
    axes = tuple(enumerate("xyz"[: paths.target_m.shape[1]]))
    columns = {
        "snapshot": snapshot.astype(np.int64),
        "sensor": names[paths.sensor[way]],
        **{f"sensor_{axis}_m": paths.sensor_m[snapshot, way, index] for index, axis in axes},
        **{name: column[snapshot, way] for name, column in values.items()},
        **by,
        **{f"truth_{axis}_m": paths.target_m[snapshot, index] for index, axis in axes},
    }
    return in_table_order(kind, columns)


def _check_dimension(options: SceneOptions, scene: Scene) -> None:
    """Raise UsageError for reflectors and parameters of the other dimension than that of the sensors."""
    only = CircleReflector if scene.has_heights else PlaneReflector | SphereReflector
    for reflector in scene.reflectors:
        if isinstance(reflector, only):
            kind = type(reflector).__name__.removesuffix("Reflector").lower()
            cure = "use a sphere" if scene.has_heights else "give the positions of the sensors three numbers"
            other = "two" if scene.has_heights else "three"
            raise UsageError(f"scene: reflector {reflector.name!r} is a {kind}, of {other} dimensions; {cure}")
    region = parse_field(options.region)
    heights = {
        "target": options.target is not None and len(options.target) == 3,
        "region": options.target is None and isinstance(region, BoxField) and region.zmin_m is not None,
    }
    if scene.has_heights:
        for name, has_height in heights.items():
            if has_height and options.target_z_m is not None:
                raise UsageError(f"`parameters` target_z_m and {name} both have heights; give one")
        return
    defaults = {field.name: field.default for field in fields(options)}
    given = [name for name, has_height in heights.items() if has_height]
    given += [name for name in options.OF_SPACE if getattr(options, name) != defaults[name]]
    if given:
        raise UsageError(
            f"`parameters` {given[0]}: has heights or elevations, but the sensors of the scene have no heights; give "
            "their positions three numbers"
        )


def _is_inside(scene: Scene, position: FloatArray, reflector: int) -> bool:
    """Return whether a sensor can have paths by a reflector: it is inside a circle or sphere, not in its blocker."""
    mirror = scene.reflectors[reflector] if reflector >= 0 else None
    if not isinstance(mirror, CircleReflector | SphereReflector):
        return True
    return (mirror.blocker_radius or 0.0) * (1.0 - 1e-6) <= dist(position, mirror.center) < mirror.radius


def _axes(points: FloatArray) -> Vector:
    """Return the coordinates x, y, z of points (..., D); 0 in the plane."""
    return *np.moveaxis(points, -1, 0), *([np.zeros(points.shape[:-1])] if points.shape[-1] == 2 else [])


def _predict_paths(
    sensor_m: FloatArray, target_m: FloatArray, reflector: IntArray, scene: Scene
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Return bearings, elevations (None in the plane) and lengths (B, K) of the paths from targets to sensors."""
    if sensor_m.shape[-1] == 2:
        bearing = predict_bearings(sensor_m, reflector, scene, target_m)
        return bearing, None, predict_ranges(sensor_m, np.zeros(reflector.shape), target_m, reflector, scene)
    vector = predict_path_vectors(_axes(sensor_m), _axes(target_m), reflector, scene)
    return *azimuth_elevation(*vector), length(vector)


def _is_blocked(scene: Scene, sensor: Vector, reflector: IntArray, target: Vector) -> BoolArray:
    """Return which paths (B, K) by a line, wall or plane cross another wall on one of their legs."""
    blocked = np.zeros(reflector.shape, dtype=bool)
    mirrors = gather_plane_mirrors(scene, reflector, sensor)
    if mirrors is None:
        return blocked
    x, y, z = (np.broadcast_to(part[:, None], reflector.shape) for part in target)
    image_x, image_y, _ = mirrors.images((x, y, z))
    near, far = np.abs(mirrors.sensor_side_m), np.abs(mirrors.side_m(*target))
    with ignoring_invalid():
        share = near / (near + far)
    hit_x, hit_y = sensor[0] + share * (image_x - sensor[0]), sensor[1] + share * (image_y - sensor[1])
    for index, wall in enumerate(scene.reflectors):
        if isinstance(wall, SegmentReflector):
            ends = [np.asarray(part) for part in (*wall.start, *wall.end)]
            meets = crosses_segment(sensor[0], sensor[1], hit_x, hit_y, *ends)
            meets |= crosses_segment(hit_x, hit_y, x, y, *ends)
            blocked |= np.isfinite(share) & (reflector != index) & meets
    return blocked


def _targets(
    options: SceneOptions, positions: FloatArray, generator: np.random.Generator, snapshots: int
) -> FloatArray:
    """Return targets (B, D): the fixed one, or uniform over the region; positions of the sensors are (K, D)."""
    height = [options.target_z_m or 0.0][: positions.shape[1] - 2]
    if options.target is not None:
        target = [*options.target, *height][: positions.shape[1]]
        return np.broadcast_to(np.array(target), (snapshots, len(target))).copy()
    origin = np.zeros(1)
    field = parse_field(options.region)
    region = search_region(field, (positions[None, :, 0], positions[None, :, 1]), (origin, origin))
    (xmin, ymin), (xmax, ymax) = ([float(part[0]) for part in bound] for bound in region.bounds_m)
    targets = np.empty((snapshots, positions.shape[1]))
    targets[:, 2:] = height
    pending = np.arange(snapshots)
    for _ in range(_DRAWS):
        x, y = generator.uniform(xmin, xmax, pending.size), generator.uniform(ymin, ymax, pending.size)
        targets[pending, :2] = np.stack([x, y], axis=1)
        inside = region.take(np.zeros(pending.size, dtype=np.int64)).contains(x, y)
        pending = pending[~inside]
        if not pending.size:
            break
    else:
        raise UsageError(f"The 'region' parameter is too thin to sample targets in it. Got {options.region!r} instead.")
    if isinstance(field, BoxField) and field.zmin_m is not None and field.zmax_m is not None:
        targets[:, 2] = generator.uniform(field.zmin_m, field.zmax_m, snapshots)
    return targets
