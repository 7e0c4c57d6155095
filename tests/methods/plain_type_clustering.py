"""Type-based clustering in plain Python, one point and one circle at a time: the slow reference."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

Point = tuple[float, float]
PointKey = tuple[int, int, int, int, int]


class PlainSet(NamedTuple):
    """A structured set: its spread, one circle (an index into the sensor's ranges) per sensor, its points' keys."""

    spread: float
    circles: tuple[int, ...]
    points: tuple[PointKey, ...]


def cross(a: Point, ra: float, b: Point, rb: float, gap_tolerance: float) -> dict[int, Point]:
    """Return the crossings by root, or the middle of the closest approach as root 0."""
    distance = math.dist(a, b)
    if distance == 0.0:
        return {}
    ux, uy = (b[0] - a[0]) / distance, (b[1] - a[1]) / distance
    if abs(ra - rb) <= distance <= ra + rb:
        along = (distance**2 + ra**2 - rb**2) / (2.0 * distance)
        height = math.sqrt(max(ra**2 - along**2, 0.0))
        foot = (a[0] + along * ux, a[1] + along * uy)
        return {0: (foot[0] - height * uy, foot[1] + height * ux), 1: (foot[0] + height * uy, foot[1] - height * ux)}
    if distance > ra + rb:
        gap, along = distance - ra - rb, ra + 0.5 * (distance - ra - rb)
    elif ra > rb:
        gap, along = ra - rb - distance, ra - 0.5 * (ra - rb - distance)
    else:
        gap, along = rb - ra - distance, -(ra + 0.5 * (rb - ra - distance))
    return {0: (a[0] + along * ux, a[1] + along * uy)} if gap <= gap_tolerance else {}


class PlainClustering:
    """All steps up to the unique sets, for sensors, ranges by sensor and a box of the field, margin included."""

    def __init__(
        self, sensors: list[Point], ranges: list[list[float]], box: tuple[float, float, float, float], gap: float
    ) -> None:
        self.sensors, self.ranges = sensors, ranges
        self.crossings: dict[tuple[int, int, int, int], dict[int, Point]] = {}
        for one, other in combinations(range(len(sensors)), 2):
            for i, ra in enumerate(ranges[one]):
                for j, rb in enumerate(ranges[other]):
                    points = cross(sensors[one], ra, sensors[other], rb, gap)
                    inside = {
                        root: (x, y)
                        for root, (x, y) in points.items()
                        if box[0] <= x <= box[1] and box[2] <= y <= box[3]
                    }
                    self.crossings[one, other, i, j] = inside

    def roots(self, one: int, i: int, other: int, j: int) -> dict[int, Point]:
        """Return the points of two circles of different sensors."""
        return self.crossings[one, other, i, j] if one < other else self.crossings[other, one, j, i]

    def gather(self, seed: Point, parents: dict[int, int]) -> tuple[int, ...] | None:
        """Return the tuple of circles of the first stage."""
        (one, i), (other, j) = parents.items()
        chosen = dict(parents)
        for p in range(len(self.sensors)):
            if p in parents:
                continue
            best, least = -1, math.inf
            for c in range(len(self.ranges[p])):
                total = 0.0
                for sensor, circle in ((one, i), (other, j)):
                    near = [math.dist(point, seed) ** 2 for point in self.roots(sensor, circle, p, c).values()]
                    total += min(near, default=math.inf)
                if total < least:
                    best, least = c, total
            if best < 0:
                return None
            chosen[p] = best
        return tuple(chosen[p] for p in range(len(self.sensors)))

    def build(self, circles: tuple[int, ...], seed: Point) -> PlainSet | None:
        """Return the structured set of a tuple of circles, of the second stage."""
        center = seed
        for _ in range(3):
            keys, points = [], []
            for one, other in combinations(range(len(self.sensors)), 2):
                roots = self.roots(one, circles[one], other, circles[other])
                if not roots:
                    return None
                root = min(roots, key=lambda r, roots=roots: (math.dist(roots[r], center), r))  # type: ignore[misc]
                keys.append((one, other, circles[one], circles[other], root))
                points.append(roots[root])
            center = (sum(x for x, _ in points) / len(points), sum(y for _, y in points) / len(points))
        return PlainSet(math.sqrt(sum(math.dist(p, center) ** 2 for p in points)), circles, tuple(keys))

    def sets(self) -> list[PlainSet]:
        """Return the different structured sets by rising spread."""
        found: dict[tuple[PointKey, ...], PlainSet] = {}
        for (one, other, i, j), points in self.crossings.items():
            for seed in points.values():
                circles = self.gather(seed, {one: i, other: j})
                built = None if circles is None else self.build(circles, seed)
                if built is not None:
                    found[built.points] = built
        return sorted(found.values())

    def unique(self, by: str) -> list[PlainSet]:
        """Return the sets that share no point (or no circle) with one of smaller spread already taken; equation (5)."""
        kept: list[PlainSet] = []
        for candidate in self.sets():
            shared = (
                any(set(candidate.points) & set(other.points) for other in kept)
                if by == "points"
                else any(a == b for other in kept for a, b in zip(candidate.circles, other.circles, strict=True))
            )
            if not shared:
                kept.append(candidate)
        return kept


def elbow(kept: list[PlainSet], eta: float) -> list[PlainSet]:
    """Return the sets before the elbow; equation (7)."""
    for k in range(1, len(kept)):
        if kept[k].spread - sum(s.spread for s in kept[:k]) / k > eta:
            return kept[:k]
    return kept
