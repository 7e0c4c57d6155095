"""The user's own scene: its targets, and every path by which a sensor can receive them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import parse_field
from nlosctl.contract.options import option
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector, Sensor
from nlosctl.errors import UsageError
from nlosctl.geometry.lines import crosses_segment, reflect_points, side_of_line
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.models.search_regions import search_region
from nlosctl.scenarios.spec import Columns, ScenarioSpec

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
    """Parameters of the scenarios with the user's own scene."""

    target: tuple[float, float] | None = option(
        None, unit="m", meaning="fixed position x,y of the target; default: random in the region"
    )
    region: str = option(
        "sensors:0.5", meaning="region of random targets, as for --field; default: around the sensors of the scene"
    )
    direct: bool = option(True, meaning="whether there are rows of the direct path, where no wall or circle is in it")
    reflected: bool = option(True, meaning="whether there are rows by the reflectors, where the path exists")
    detection_probability: float = option(
        1.0, minimum=0.0, maximum=1.0, meaning="probability that a row is there, if its path exists"
    )

    def __post_init__(self) -> None:
        parse_field(self.region)


def scenario_in_scene(*, name: str, options: type[SceneOptions], generate: Callable[..., Columns]) -> ScenarioSpec:
    """Return the scenario of the kind ``name`` in `SQUARE`, or in a scene of the user's own: ``generate(scene=)``."""

    def of_scene(own: Scene) -> ScenarioSpec:
        return replace(spec, scene=lambda options: own, generate=partial(generate, scene=own))

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
    """Paths of B snapshots by K ways each: sensor and reflector (K,), targets (B, 2), and which exist (B, K).

    ``bearing_rad`` (B, K) is that of the path at the sensor; ``reflector`` is -1 for the direct path.
    """

    scene: Scene
    sensor: IntArray
    reflector: IntArray
    sensor_xy_m: FloatArray
    target_xy_m: FloatArray
    bearing_rad: FloatArray
    exists: BoolArray


def scene_paths(options: SceneOptions, scene: Scene, generator: np.random.Generator, snapshots: int) -> ScenePaths:
    """Sample a target for each snapshot, and find all paths to the sensors; raises UsageError without sensors.

    A wall (segment) hides what is behind it from every path, a line mirror reflects on the side of the sensor, and
    circles and their blockers limit paths as `nlosctl.models.obstacles` describes.
    """
    if not scene.sensors:
        raise UsageError("`scene` has no sensors; add a table [[sensor]] with name and position for each")
    sensors = scene.stationary_sensors("the simulation")
    positions = np.array([sensor.position for sensor in sensors.values()])
    reflectors = [*([-1] if options.direct else []), *(range(len(scene.reflectors)) if options.reflected else [])]
    ways = [(s, r) for s in range(len(positions)) for r in reflectors if _is_inside(scene, positions[s], r)]
    if not ways:
        raise UsageError("the scene has no path: set `parameters` direct=true, or add reflectors")
    sensor, reflector = np.array(ways, dtype=np.int64).T
    target = _targets(options, positions, generator, snapshots)
    shape = (snapshots, len(ways))
    sensor_xy = np.broadcast_to(positions[sensor], (*shape, 2))
    by = np.broadcast_to(reflector, shape)
    bearing = predict_bearings(sensor_xy, by, scene, np.broadcast_to(target[:, None], (*shape, 2)))
    batch = BearingBatch(
        scene=scene,
        seed=np.zeros(snapshots, dtype=np.uint64),
        sensor=np.broadcast_to(sensor, shape),
        sensor_xy_m=sensor_xy,
        bearing_rad=np.nan_to_num(bearing),
        bearing_std_rad=np.ones(shape),
        path=np.zeros(shape, dtype=np.int64),
        reflector=by,
    )
    lines = sight_lines(batch)
    unseen = lines.unseen(target[:, 0] - lines.center_x, target[:, 1] - lines.center_y)
    drawn = generator.random(shape) < options.detection_probability
    exists = ~unseen & np.isfinite(bearing) & ~_is_blocked(scene, sensor_xy, by, target) & drawn
    return ScenePaths(scene, sensor, reflector, sensor_xy, target, bearing, exists)


def row_columns(paths: ScenePaths, values: Columns) -> Columns:
    """Return the columns of a file: those of ``values`` (B, K) and of the paths, in rows where a path exists."""
    snapshot, way = np.nonzero(paths.exists)
    names = np.array([sensor.name for sensor in paths.scene.sensors], dtype=object)
    by = {}
    if paths.scene.reflectors:
        by["reflector"] = np.array([*paths.scene.reflector_names, None], dtype=object)[paths.reflector[way]]
    return {
        "snapshot": snapshot.astype(np.int64),
        "sensor": names[paths.sensor[way]],
        "sensor_x_m": paths.sensor_xy_m[snapshot, way, 0],
        "sensor_y_m": paths.sensor_xy_m[snapshot, way, 1],
        **{name: column[snapshot, way] for name, column in values.items() if name != "truth_los"},
        **by,
        "truth_x_m": paths.target_xy_m[snapshot, 0],
        "truth_y_m": paths.target_xy_m[snapshot, 1],
        "truth_los": values["truth_los"][snapshot, way],
    }


def _is_inside(scene: Scene, position: FloatArray, reflector: int) -> bool:
    """Return whether a sensor can have paths by a reflector: it is inside a circle, and not in its blocker."""
    circle = scene.reflectors[reflector] if reflector >= 0 else None
    if not isinstance(circle, CircleReflector):
        return True
    distance = float(np.hypot(position[0] - circle.center[0], position[1] - circle.center[1]))
    return (circle.blocker_radius or 0.0) * (1.0 - 1e-6) <= distance < circle.radius


def _is_blocked(scene: Scene, sensor_xy_m: FloatArray, reflector: IntArray, target_xy_m: FloatArray) -> BoolArray:
    """Return which paths (B, K) by a line or wall cross another wall on one of their legs."""
    blocked = np.zeros(reflector.shape, dtype=bool)
    walls = [(i, wall) for i, wall in enumerate(scene.reflectors) if isinstance(wall, SegmentReflector)]
    sensor_x, sensor_y = sensor_xy_m[..., 0], sensor_xy_m[..., 1]
    x, y = (np.broadcast_to(target_xy_m[:, None, axis], reflector.shape) for axis in (0, 1))
    for index, mirror in enumerate(scene.reflectors):
        if not isinstance(mirror, LineReflector | SegmentReflector):
            continue
        angle = np.arctan2(mirror.direction[1], mirror.direction[0])
        point_x, point_y = np.asarray(mirror.point[0]), np.asarray(mirror.point[1])
        image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
        near = np.abs(side_of_line(sensor_x, sensor_y, point_x, point_y, angle))
        far = np.abs(side_of_line(image_x, image_y, point_x, point_y, angle))
        with np.errstate(invalid="ignore", divide="ignore"):
            share = near / (near + far)
        hit_x, hit_y = sensor_x + share * (image_x - sensor_x), sensor_y + share * (image_y - sensor_y)
        for other, wall in walls:
            if other != index:
                x1, y1, x2, y2 = (np.asarray(part) for part in (*wall.start, *wall.end))
                meets = crosses_segment(sensor_x, sensor_y, hit_x, hit_y, x1, y1, x2, y2)
                meets |= crosses_segment(hit_x, hit_y, x, y, x1, y1, x2, y2)
                blocked |= (reflector == index) & meets
    return blocked


def _targets(
    options: SceneOptions, positions: FloatArray, generator: np.random.Generator, snapshots: int
) -> FloatArray:
    """Return targets (B, 2): the fixed one, or uniform over the region."""
    if options.target is not None:
        return np.broadcast_to(np.array(options.target), (snapshots, 2)).copy()
    origin = np.zeros(1)
    region = search_region(
        parse_field(options.region), (positions[None, :, 0], positions[None, :, 1]), (origin, origin)
    )
    (xmin, ymin), (xmax, ymax) = ([float(part[0]) for part in bound] for bound in region.bounds_m)
    targets = np.empty((snapshots, 2))
    pending = np.arange(snapshots)
    for _ in range(_DRAWS):
        x, y = generator.uniform(xmin, xmax, pending.size), generator.uniform(ymin, ymax, pending.size)
        targets[pending] = np.stack([x, y], axis=1)
        inside = region.take(np.zeros(pending.size, dtype=np.int64)).contains(x, y)
        pending = pending[~inside]
        if not pending.size:
            return targets
    raise UsageError(f"The 'region' parameter is too thin to sample targets in it. Got {options.region!r} instead.")
