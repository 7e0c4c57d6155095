"""The search region of each snapshot, about its local origin."""

from __future__ import annotations

from functools import reduce

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point
from nlosctl.contract.fields import BoxField, CircleField, Field, PolygonField
from nlosctl.geometry.blocks import max_measurements
from nlosctl.geometry.regions import BoxRegion, CircleRegion, PolygonRegion, PrismRegion, Region

__all__ = ["limit_height", "near_edge", "reach_region", "search_region"]


def search_region(field: Field, sensors: Point, center: Point) -> Region:
    """Return the regions (B,) that ``field`` means, about the local origins ``center``, D arrays (B,).

    ``sensors``, D arrays (B, K), are the sensors' positions in the same frame as ``center`` (metres). A `SensorsField`
    of sensors at a single point is that point alone; `reach_region` enlarges it by measured ranges. In space a circle,
    a polygon or a box without heights is a prism whose heights are those of the sensors, extended up and down by the
    larger side of its bounds.
    """
    if isinstance(field, BoxField | CircleField | PolygonField):
        base = _plane_region(field, center)
        if len(center) == 2:
            return base
        if isinstance(field, BoxField) and field.zmin_m is not None and field.zmax_m is not None:
            return PrismRegion(base, field.zmin_m - center[2], field.zmax_m - center[2])
        return _prism(base, sensors[2] - center[2][:, None])
    about = [part - origin[:, None] for part, origin in zip(sensors, center, strict=True)]
    lower, upper = [-max_measurements(-part) for part in about], [max_measurements(part) for part in about]
    sides = [most - least for least, most in zip(lower, upper, strict=True)]
    margin = field.factor * reduce(np.maximum, sides)
    return BoxRegion(tuple(part - margin for part in lower), tuple(part + margin for part in upper))


def reach_region(region: Region, points: Point, reach_m: FloatArray) -> Region:
    """Return boxes (B,) that contain regions and all within ``reach_m`` (B,) of the box of points, D arrays (B, K)."""
    lower, upper = region.bounds_m
    return BoxRegion(
        tuple(np.minimum(least, -max_measurements(-part) - reach_m) for least, part in zip(lower, points, strict=True)),
        tuple(np.maximum(most, max_measurements(part) + reach_m) for most, part in zip(upper, points, strict=True)),
    )


def near_edge(field: Field, sensors: Point, position_m: FloatArray, share: float) -> BoolArray:
    """Return which positions (D, E) are on the edge of the region that ``field`` means with sensors, D arrays (E, K).

    On the edge is within a ``share`` of the region's largest side.
    """
    center = tuple(part[:, 0] for part in sensors)
    region = search_region(field, sensors, center)
    side = reduce(np.maximum, [most - least for least, most in zip(*region.bounds_m, strict=True)])
    away = (part - middle for part, middle in zip(position_m, center, strict=True))
    return region.on_edge(*away, tolerance_m=share * side)


def limit_height(region: Region, z_m: FloatArray, reach_m: FloatArray) -> Region:
    """Return regions of space (B,) that reach from ``z_m - reach_m`` to ``z_m + reach_m``, where both are finite."""
    (*lower, bottom), (*upper, top) = region.bounds_m
    known = np.isfinite(z_m) & np.isfinite(reach_m)
    zmin, zmax = np.where(known, z_m - reach_m, bottom), np.where(known, z_m + reach_m, top)
    if isinstance(region, PrismRegion):
        return PrismRegion(region.base, zmin, zmax)
    return BoxRegion((*lower, zmin), (*upper, zmax))


def _plane_region(field: BoxField | CircleField | PolygonField, center: Point) -> Region:
    center_x, center_y = center[:2]
    if isinstance(field, BoxField):
        return BoxRegion(
            (field.xmin_m - center_x, field.ymin_m - center_y), (field.xmax_m - center_x, field.ymax_m - center_y)
        )
    if isinstance(field, CircleField):
        return CircleRegion(field.x_m - center_x, field.y_m - center_y, np.full(center_x.shape, field.radius_m))
    x, y = np.array(field.vertices_m).T
    return PolygonRegion(x - center_x[:, None], y - center_y[:, None])


def _prism(base: Region, sensor_z: FloatArray) -> PrismRegion:
    """Return the regions of space over regions of the plane, about as high as those are wide."""
    lower, upper = base.bounds_m
    margin = reduce(np.maximum, [most - least for least, most in zip(lower, upper, strict=True)])
    return PrismRegion(base, -max_measurements(-sensor_z) - margin, max_measurements(sensor_z) + margin)
