"""A room with reflecting walls: one transmitter, several receivers, a target, and legs with at most one wall bounce."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.scenarios.spec import Columns, ScenarioSpec
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["SCENARIO", "RoomOptions", "generate", "scene"]

_MARGIN = 0.05
"""Smallest distance of nodes and targets from the walls, as a share of the room's sides."""
_LEGS = 5
"""Legs between a node and the target: the straight one, and one via each of the four walls."""


@dataclass(frozen=True, kw_only=True)
class RoomOptions:
    """Parameters of ``room``."""

    width_m: float = option(10.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the room along x")
    depth_m: float = option(8.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the room along y")
    receivers: int = option(3, minimum=1, maximum=1000, meaning="receivers, at random positions in each snapshot")
    paths: int = option(4, minimum=1, maximum=_LEGS**2, meaning="paths resolved at each receiver, the shortest ones")
    blocked_fraction: float = option(
        0.1, minimum=0.0, maximum=1.0, meaning="share of the receivers whose direct path is blocked"
    )
    angle_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of both angles"
    )
    path_length_std_m: float = option(
        0.1, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of the path length"
    )


def scene(options: RoomOptions) -> Scene:
    """Return the four walls; the room is centred on (0, 0)."""
    x, y = 0.5 * options.width_m, 0.5 * options.depth_m
    walls = (("west", (-x, 0.0), (0.0, 1.0)), ("east", (x, 0.0), (0.0, 1.0)),
             ("south", (0.0, -y), (1.0, 0.0)), ("north", (0.0, y), (1.0, 0.0)))  # fmt: skip
    return Scene(
        reflectors=tuple(LineReflector(name=name, point=point, direction=along) for name, point, along in walls)
    )


def generate(options: RoomOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with a transmitter, a target and receivers anywhere in the room.

    A path goes from the transmitter via at most one wall to the target, and via at most one wall to a receiver, by the
    image method: all images exist in a rectangular room. A path that touches no wall is direct.
    """
    receivers = options.receivers
    tx, target = _inside(generator, options, (snapshots, 1)), _inside(generator, options, (snapshots, 1))
    rx = _inside(generator, options, (snapshots, receivers))
    # The angle at a node points to the target's image in the wall.
    images = _images(options, target)
    from_tx, from_rx = images - tx[:, :, None], images - rx[:, :, None]
    out, back = np.hypot(*np.moveaxis(from_tx, -1, 0)), np.hypot(*np.moveaxis(from_rx, -1, 0))
    first, second = np.divmod(np.arange(_LEGS**2), _LEGS)
    length = out[:, :, first] + back[:, :, second]
    blocked = generator.random((snapshots, receivers)) < options.blocked_fraction
    unblocked = np.where(blocked[:, :, None] & (first + second == 0), np.inf, length)
    shortest = np.argsort(unblocked, axis=2, kind="stable")[:, :, : options.paths]
    resolved = np.isfinite(np.take_along_axis(unblocked, shortest, axis=2))
    dod = np.arctan2(from_tx[..., 1], from_tx[..., 0])[:, :, first]
    doa = np.arctan2(from_rx[..., 1], from_rx[..., 0])[:, :, second]
    snapshot, receiver, _ = np.nonzero(resolved)
    chosen = shortest[resolved]

    def flat(values: FloatArray) -> FloatArray:
        """Return the values (B, R or 1, paths) of the resolved paths."""
        return np.asarray(np.broadcast_to(values, length.shape)[snapshot, receiver, chosen])

    counts = np.bincount(snapshot, minlength=snapshots)
    rows = snapshot.shape[0]
    angle_std = np.full(rows, np.radians(options.angle_std_deg))
    return triplet_columns(
        generator=generator,
        snapshot=snapshot,
        path=np.arange(rows) - np.repeat(np.cumsum(counts) - counts, counts),
        tx_xy_m=tx[snapshot, 0],
        rx_xy_m=rx[snapshot, receiver],
        triplet=(flat(dod), flat(doa), flat(length)),
        stds=(angle_std, angle_std, np.full(rows, options.path_length_std_m)),
        truth_ip=chosen > 0,
        target_xy_m=target[snapshot, 0],
    )


def _inside(generator: np.random.Generator, options: RoomOptions, shape: tuple[int, int]) -> FloatArray:
    half = (0.5 - _MARGIN) * np.array([options.width_m, options.depth_m])
    return generator.uniform(-half, half, (*shape, 2))


def _images(options: RoomOptions, target: FloatArray) -> FloatArray:
    """Return the target (B, 1, 2) and its images in the four walls, (B, 1, 5, 2), walls in the scene's order."""
    images = np.repeat(target[:, :, None], _LEGS, axis=2)
    for leg, (axis, side) in enumerate(((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)), 1):
        wall = side * 0.5 * (options.width_m, options.depth_m)[axis]
        images[:, :, leg, axis] = 2.0 * wall - images[:, :, leg, axis]
    return images


SCENARIO = ScenarioSpec(
    name="room",
    kind="triplets",
    summary="a rectangular room: a target, one transmitter, several receivers, legs with at most one wall bounce",
    reference="generic",
    options=RoomOptions,
    scene=scene,
    generate=generate,
)
