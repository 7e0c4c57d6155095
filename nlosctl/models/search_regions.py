"""The search region of each snapshot, about its local origin."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.fields import BoxField, CircleField, Field, PolygonField
from nlosctl.geometry.blocks import max_measurements
from nlosctl.geometry.regions import BoxRegion, CircleRegion, PolygonRegion, Region

__all__ = ["reach_region", "search_region"]


def search_region(
    field: Field, sensor_x: FloatArray, sensor_y: FloatArray, center_x: FloatArray, center_y: FloatArray
) -> Region:
    """Return the regions (B,) that ``field`` means, about the local origins ``center`` (B,).

    ``sensor_x`` and ``sensor_y`` (B, K) are the sensors' positions in the same frame as ``center`` (metres). A
    `SensorsField` of sensors at a single point is that point alone; `reach_region` enlarges it by measured ranges.
    """
    if isinstance(field, BoxField):
        return BoxRegion(
            field.xmin_m - center_x, field.xmax_m - center_x, field.ymin_m - center_y, field.ymax_m - center_y
        )
    if isinstance(field, CircleField):
        return CircleRegion(field.x_m - center_x, field.y_m - center_y, np.full(center_x.shape, field.radius_m))
    if isinstance(field, PolygonField):
        x, y = np.array(field.vertices_m).T
        return PolygonRegion(x - center_x[:, None], y - center_y[:, None])
    x, y = sensor_x - center_x[:, None], sensor_y - center_y[:, None]
    xmin, xmax = -max_measurements(-x), max_measurements(x)
    ymin, ymax = -max_measurements(-y), max_measurements(y)
    margin = field.factor * np.maximum(xmax - xmin, ymax - ymin)
    return BoxRegion(xmin - margin, xmax + margin, ymin - margin, ymax + margin)


def reach_region(region: Region, x: FloatArray, y: FloatArray, reach_m: FloatArray) -> Region:
    """Return boxes (B,) that contain regions and all within ``reach_m`` (B,) of the box of points x, y (B, K)."""
    xmin, xmax, ymin, ymax = region.bounds_m
    return BoxRegion(
        np.minimum(xmin, -max_measurements(-x) - reach_m),
        np.maximum(xmax, max_measurements(x) + reach_m),
        np.minimum(ymin, -max_measurements(-y) - reach_m),
        np.maximum(ymax, max_measurements(y) + reach_m),
    )
