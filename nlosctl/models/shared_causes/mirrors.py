"""How rows change with the mirrors of their scene: lines, walls and planes in closed form, circles and spheres not.

A row by a mirror with the unit normal n through c measures the image x' = x - 2 ((x - c).n) n of the source x. Its
derivatives by x are J F with F = I - 2 n n' and J those by the image. By the offset of the mirror along n the image
moves by 2 n, so that the row changes by -2 n.(J F)'; turned about c, dn = -u, by 2 ((x - c).n) u - 2 ((x - c).u) n
times J F; and with the sensor, which the image is seen from, by -J = -(J F) F.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import (
    CircleReflector,
    LineReflector,
    PlaneReflector,
    Reflector,
    Scene,
    SegmentReflector,
    SphereReflector,
)

__all__ = ["FlatMirrors", "flat_mirrors", "is_round", "with_radii"]

Vector = tuple[FloatArray, ...]


@dataclass(frozen=True)
class FlatMirrors:
    """The flat mirror of each row (B, K) in D dimensions: unit normal (0 without one), tangents, a point, stds.

    A mirror turns about its point along each of the tangents, by errors of ``direction_std_rad`` each.
    """

    normal: Vector
    tangents: tuple[Vector, ...]
    point: Vector
    offset_std_m: FloatArray
    direction_std_rad: FloatArray

    def by_sensor(self, slopes: Vector) -> Vector:
        """Return the derivatives (B, K) by the coordinates of the sensor, by those of the source."""
        along = _dot(slopes, self.normal)
        return tuple(2.0 * along * own - part for part, own in zip(slopes, self.normal, strict=True))

    def errors(self, slopes: Vector, source: Vector) -> list[FloatArray]:
        """Return the errors (B, K) per standard normal cause: the offset, and each direction; source (B, 1) each."""
        away = tuple(part - own for part, own in zip(source, self.point, strict=True))
        along, height = _dot(slopes, self.normal), _dot(away, self.normal)
        errors = [-2.0 * along * self.offset_std_m]
        for tangent in self.tangents:
            turned = 2.0 * (height * _dot(slopes, tangent) - _dot(away, tangent) * along)
            errors.append(turned * self.direction_std_rad)
        return errors


def flat_mirrors(scene: Scene, reflector: IntArray, dimension: int) -> FlatMirrors:
    """Return the mirrors of rows by the reflectors (B, K) of a scene, -1 for direct rows."""
    rows = [*(_flat(one, dimension) for one in scene.reflectors), [0.0] * (4 * dimension + 2)]
    table = np.array(rows)[reflector]
    parts = [table[..., index] for index in range(table.shape[-1])]
    vectors = [tuple(parts[start : start + dimension]) for start in range(0, 4 * dimension, dimension)]
    normal, *tangents, point = vectors
    return FlatMirrors(normal, tuple(tangents[: dimension - 1]), point, parts[-2], parts[-1])


def _flat(mirror: Reflector, dimension: int) -> list[float]:
    """Return normal, two tangents, a point and both stds of a flat mirror; zeros for others."""
    if isinstance(mirror, LineReflector | SegmentReflector):
        along = np.array(mirror.direction) / np.hypot(*mirror.direction)
        upright = [np.append(part, np.zeros(dimension - 2)) for part in ((-along[1], along[0]), along)]
        second, point = np.zeros(dimension), np.append(mirror.point, np.zeros(dimension - 2))
        vectors = [*upright, second, point]
    elif isinstance(mirror, PlaneReflector) and dimension == 3:
        normal = np.array(mirror.normal) / np.linalg.norm(mirror.normal)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        vectors = [normal, first, np.cross(normal, first), np.array(mirror.point)]
    else:
        return [0.0] * (4 * dimension + 2)
    stds = [mirror.offset_std_m or 0.0, np.radians(mirror.direction_std_deg or 0.0)]
    return [*(float(value) for vector in vectors for value in vector), *stds]


def is_round(scene: Scene, reflector: IntArray) -> BoolArray:
    """Return which rows (B, K) are by a circle or a sphere."""
    known = [*(isinstance(one, CircleReflector | SphereReflector) for one in scene.reflectors), False]
    return np.array(known)[reflector]


def with_radii(scene: Scene, by_m: float) -> tuple[Scene, FloatArray]:
    """Return the scene with radii larger by ``by_m``, and the stds (R + 1,) of the radii, the last for direct rows."""
    from dataclasses import replace

    moved = tuple(
        replace(one, radius=one.radius + by_m) if isinstance(one, CircleReflector | SphereReflector) else one
        for one in scene.reflectors
    )
    stds = [getattr(one, "radius_std_m", None) or 0.0 for one in scene.reflectors]
    return replace(scene, reflectors=moved), np.array([*stds, 0.0])


def _dot(left: Vector, right: Vector) -> FloatArray:
    total = left[0] * right[0]
    for one, other in zip(left[1:], right[1:], strict=True):
        total = total + one * other
    return np.asarray(total)
