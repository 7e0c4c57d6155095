"""A room with reflecting walls: one transmitter, several receivers, a target, and legs with at most one wall bounce."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import LineReflector, PlaneReflector, Reflector, Scene
from nlosctl.errors import UsageError
from nlosctl.geometry.directions import azimuth_elevation
from nlosctl.scenarios.spec import Columns, ScenarioSpec
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["SCENARIO", "RoomOptions", "generate", "scene"]

_MARGIN = 0.05
"""Smallest distance of nodes and targets from the walls, as a share of the room's sides."""


@dataclass(frozen=True, kw_only=True)
class RoomOptions:
    """Parameters of ``room``; the heights matter with ``dimensions=3``."""

    dimensions: Literal[2, 3] = option(2, meaning="2: a plan; 3: with floor and ceiling, and elevations")
    width_m: float = option(10.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the room along x")
    depth_m: float = option(8.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the room along y")
    height_m: float = option(3.0, unit="m", minimum=0.0, exclusive=True, meaning="height of the room")
    receivers: int = option(3, minimum=1, maximum=1000, meaning="receivers, at random positions in each snapshot")
    paths: int = option(
        4, minimum=1, maximum=49, meaning="paths resolved at each receiver, the shortest ones; there are 25 in a plan"
    )
    blocked_fraction: float = option(
        0.1, minimum=0.0, maximum=1.0, meaning="share of the receivers whose direct path is blocked"
    )
    angle_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of all angles"
    )
    path_length_std_m: float = option(
        0.1, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of the path length"
    )

    def __post_init__(self) -> None:
        if self.dimensions == 2 and self.paths > 25:
            raise UsageError(f"The 'paths' parameter must be at most 25 with dimensions=2. Got {self.paths} instead.")

    @property
    def sides_m(self) -> tuple[float, ...]:
        """The sides of the room along each axis."""
        return (self.width_m, self.depth_m, self.height_m)[: self.dimensions]

    @property
    def middle_m(self) -> FloatArray:
        """The centre of the room: above (0, 0), the floor at height 0."""
        return np.array([0.0, 0.0, 0.5 * self.height_m])[: self.dimensions]


def scene(options: RoomOptions) -> Scene:
    """Return the four walls, in space also floor and ceiling; the room is centred on (0, 0)."""
    x, y = 0.5 * options.width_m, 0.5 * options.depth_m
    walls = (("west", (-x, 0.0), (0.0, 1.0)), ("east", (x, 0.0), (0.0, 1.0)),
             ("south", (0.0, -y), (1.0, 0.0)), ("north", (0.0, y), (1.0, 0.0)))  # fmt: skip
    reflectors: list[Reflector] = [
        LineReflector(name=name, point=point, direction=along) for name, point, along in walls
    ]
    if options.dimensions == 3:
        for name, height in (("floor", 0.0), ("ceiling", options.height_m)):
            reflectors.append(PlaneReflector(name=name, point=(0.0, 0.0, height), normal=(0.0, 0.0, 1.0)))
    return Scene(reflectors=tuple(reflectors))


def generate(options: RoomOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with a transmitter, a target and receivers anywhere in the room.

    A path goes from the transmitter via at most one wall to the target, and via at most one wall to a receiver, by the
    image method: all images exist in a rectangular room. A path that touches no wall is direct. Floor and ceiling are
    walls, too.
    """
    receivers = options.receivers
    tx, target = _inside(generator, options, (snapshots, 1)), _inside(generator, options, (snapshots, 1))
    rx = _inside(generator, options, (snapshots, receivers))
    # The angle at a node points to the target's image in the wall.
    images = _images(options, target)
    from_tx, from_rx = images - tx[:, :, None], images - rx[:, :, None]
    out, back = (reduce(np.hypot, np.moveaxis(way, -1, 0)) for way in (from_tx, from_rx))
    first, second = np.divmod(np.arange(out.shape[2] ** 2), out.shape[2])
    length = out[:, :, first] + back[:, :, second]
    blocked = generator.random((snapshots, receivers)) < options.blocked_fraction
    unblocked = np.where(blocked[:, :, None] & (first + second == 0), np.inf, length)
    shortest = np.argsort(unblocked, axis=2, kind="stable")[:, :, : options.paths]
    resolved = np.isfinite(np.take_along_axis(unblocked, shortest, axis=2))
    snapshot, receiver, _ = np.nonzero(resolved)
    chosen = shortest[resolved]

    def flat(values: FloatArray) -> FloatArray:
        """Return the values (B, R or 1, paths) of the resolved paths."""
        return np.asarray(np.broadcast_to(values, length.shape)[snapshot, receiver, chosen])

    dod, doa = _angles(from_tx)[..., first], _angles(from_rx)[..., second]
    triplet = [flat(dod[0]), flat(doa[0]), flat(length), *map(flat, (*dod[1:], *doa[1:]))]
    counts = np.bincount(snapshot, minlength=snapshots)
    rows = snapshot.shape[0]
    stds = [np.full(rows, np.radians(options.angle_std_deg)) for _ in triplet]
    stds[2] = np.full(rows, options.path_length_std_m)
    return triplet_columns(
        generator=generator,
        snapshot=snapshot,
        path=np.arange(rows) - np.repeat(np.cumsum(counts) - counts, counts),
        tx_m=tx[snapshot, 0],
        rx_m=rx[snapshot, receiver],
        triplet=tuple(triplet),
        stds=tuple(stds),
        truth_ip=chosen > 0,
        target_m=target[snapshot, 0],
    )


def _inside(generator: np.random.Generator, options: RoomOptions, shape: tuple[int, int]) -> FloatArray:
    half = (0.5 - _MARGIN) * np.array(options.sides_m)
    return options.middle_m + generator.uniform(-half, half, (*shape, half.size))


def _images(options: RoomOptions, target: FloatArray) -> FloatArray:
    """Return the target (B, 1, D) and its images in the walls, (B, 1, 1 + 2 D, D), in the order of the scene."""
    images = [target]
    for axis, (side, middle) in enumerate(zip(options.sides_m, options.middle_m.tolist(), strict=True)):
        for wall in (middle - 0.5 * side, middle + 0.5 * side):
            image = target.copy()
            image[..., axis] = 2.0 * wall - image[..., axis]
            images.append(image)
    return np.stack(images, axis=2)


def _angles(way: FloatArray) -> FloatArray:
    """Return the azimuth of vectors (..., D), in space also the elevation: (D - 1, ...)."""
    if way.shape[-1] == 2:
        return np.arctan2(way[..., 1], way[..., 0])[None]
    return np.stack(azimuth_elevation(*np.moveaxis(way, -1, 0)))


SCENARIO = ScenarioSpec(
    name="room",
    kind="triplets",
    summary="a rectangular room, in the plane or in space: a target, one transmitter, several receivers, legs with at "
    "most one wall bounce",
    reference="generic",
    options=RoomOptions,
    scene=scene,
    generate=generate,
)
