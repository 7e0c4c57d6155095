"""Where the spheres of ranges cross: of three rows, or of two at a measured height."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.geometry.circles import cross_circles
from nlosctl.geometry.spheres import cross_spheres
from nlosctl.models.ranges.spheres import RangeSpheres

__all__ = ["cross_at_height", "cross_triples"]


def cross_triples(rows: RangeSpheres, triples: IntArray) -> Point:
    """Return both crossings, (B, 2 T), of triples (T, 3) or (B, T, 3) of rows; not finite for sensors on a line."""
    snapshot = np.arange(rows.range_m.shape[0])[:, None]
    centers = [tuple(part[snapshot, triples[..., n]] for part in rows.sensor) for n in range(3)]
    radii = [rows.range_m[snapshot, triples[..., n]] for n in range(3)]
    one, other = cross_spheres(centers, radii)
    return tuple(np.concatenate(pair, axis=1) for pair in zip(one, other, strict=True))


def cross_at_height(rows: RangeSpheres, first: IntArray, second: IntArray) -> Point:
    """Return both crossings, (B, 2 P), of pairs (P,) or (B, P) of spheres at the measured height; NaN without one.

    Circles that do not cross have the middle of their closest approach.
    """
    assert rows.level is not None  # noqa: S101 - asked for where a height is measured
    z = np.where(rows.level.known, rows.level.z_m, np.nan)[:, None]
    snapshot = np.arange(rows.range_m.shape[0])[:, None]
    centers, radii = [], []
    for index in (first, second):
        x, y, own_z = (part[snapshot, index] for part in rows.sensor)
        centers.append(np.stack([x, y], axis=-1))
        radii.append(np.sqrt(np.maximum(rows.range_m[snapshot, index] ** 2 - (own_z - z) ** 2, 0.0)))
    points: FloatArray = cross_circles(centers[0], radii[0], centers[1], radii[1], gap_tolerance=np.inf)
    x, y = (np.concatenate([points[..., 0, axis], points[..., 1, axis]], axis=1) for axis in (0, 1))
    return x, y, np.broadcast_to(z, x.shape)
