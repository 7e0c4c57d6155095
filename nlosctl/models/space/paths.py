"""Exact paths in space from sources to sensors: direct, by plane mirrors and walls, by spheres."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.directions import Vector, azimuth_elevation, scaled, subtract
from nlosctl.geometry.spheres import central_plane
from nlosctl.models.circle_rows import likeliest_points
from nlosctl.models.space.plane_mirrors import gather_plane_mirrors
from nlosctl.models.space.sphere_rows import sphere_table

__all__ = ["predict_directions", "predict_path_vectors"]


def predict_path_vectors(sensor: Vector, source: Vector, reflector: IntArray, scene: Scene) -> Vector:
    """Return vectors from sensors in the direction from which a wave comes, as long as its path, three arrays (...).

    By a plane the sensor looks at the source's image. By a sphere along the shortest path that no blocker cuts (of all
    where each is cut); NaN where there is no path. ``reflector`` (...) is -1 for direct paths. Not checked: that a
    mirror reflects on the sensor's side, and that no wall is in the way.
    """
    vector = subtract(source, sensor)
    if not (reflector >= 0).any():
        return vector
    mirrors = gather_plane_mirrors(scene, reflector, sensor)
    if mirrors is not None:
        vector = subtract(mirrors.images(source), sensor)
    table = sphere_table(scene)
    bent = (reflector >= 0) & np.isfinite(table[0])[reflector]
    if bent.any():
        *center, radius, blocker, _ = (column[reflector[bent]] for column in table)
        about = (
            tuple(part[bent] - middle for part, middle in zip(end, center, strict=True)) for end in (sensor, source)
        )
        plane = central_plane(*about)
        path = plane.path_by(*likeliest_points(*plane.points, radius, blocker))
        for part, values in zip(vector, scaled(path.direction, path.flat.length_m), strict=True):
            part[bent] = values
    return vector


def predict_directions(
    sensor: Vector, source: Vector, reflector: IntArray, scene: Scene
) -> tuple[FloatArray, FloatArray]:
    """Return noise-free azimuths and elevations (...) of sources at sensors: those of `predict_path_vectors`."""
    return azimuth_elevation(*predict_path_vectors(sensor, source, reflector, scene))
