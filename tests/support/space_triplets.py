"""Batches of triplets in a room in space, direct or over one wall, by the image method."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import TripletBatch

SIDES_M = np.array([10.0, 8.0, 3.0])
"""The sides of the room; a corner is the origin."""

SCALARS = ("dod_rad", "doa_rad", "path_length_m", "dod_elevation_rad", "doa_elevation_rad")
"""The measured arrays, in the order of `predict`."""


def predict(tx, rx, seen_from_tx, seen_from_rx=None):
    """Return the five noise-free scalars (5, ...) of paths over points (..., 3), or their images."""
    departing = seen_from_tx - tx
    arriving = (seen_from_tx if seen_from_rx is None else seen_from_rx) - rx

    def angles(ray):
        return np.arctan2(ray[..., 1], ray[..., 0]), np.arctan2(ray[..., 2], np.hypot(ray[..., 0], ray[..., 1]))

    dod, doa = angles(departing), angles(arriving)
    length = np.linalg.norm(departing, axis=-1) + np.linalg.norm(arriving, axis=-1)
    return np.array([dod[0], doa[0], length, dod[1], doa[1]])


def space_batch(tx, rx, values, stds, **fields):
    """Return the batch of values (5, B, K) for nodes (B, K, 3); ``stds`` are five numbers or arrays."""
    stds = [np.broadcast_to(std, values[0].shape) for std in stds]
    names = ("dod_std_rad", "doa_std_rad", "path_length_std_m", "dod_elevation_std_rad", "doa_elevation_std_rad")
    arrays = {"tx_xy_m": tx[..., :2], "rx_xy_m": rx[..., :2], "tx_z_m": tx[..., 2], "rx_z_m": rx[..., 2]}
    arrays |= dict(zip(SCALARS, values, strict=True)) | dict(zip(names, stds, strict=True)) | fields
    arrays = {
        name: np.asfortranarray(array) if isinstance(array, np.ndarray) else array for name, array in arrays.items()
    }
    return TripletBatch(dimension=3, seed=np.zeros(values[0].shape[0], dtype=np.uint64), **arrays)


def draw_space_room(generator, snapshots, paths=1, *, degrees=1.0, length_std_m=0.1, indirect=False, sides_m=SIDES_M):
    """Return a batch and its targets (B, 3); with ``indirect`` every path is over one wall, floor or ceiling.

    A transmitter and a target per snapshot, and a receiver per path.
    """
    tx, rx, target = (sides_m * generator.uniform(0.05, 0.95, (snapshots, count, 3)) for count in (1, paths, 1))
    tx = np.repeat(tx, paths, axis=1)
    seen_from_tx, seen_from_rx = (np.repeat(target, paths, axis=1) for _ in range(2))
    if indirect:
        axis, side, first = (generator.integers(0, high, (snapshots, paths)) for high in (3, 2, 2))
        image = seen_from_tx.copy()
        rows = (*np.indices(axis.shape), axis)
        image[rows] = 2.0 * side * sides_m[axis] - image[rows]
        seen_from_tx = np.where((first == 0)[..., None], image, seen_from_tx)
        seen_from_rx = np.where((first == 1)[..., None], image, seen_from_rx)
    angle = np.radians(degrees)
    stds = (angle, angle, length_std_m, angle, angle)
    values = predict(tx, rx, seen_from_tx, seen_from_rx)
    values = values + np.array(stds)[:, None, None] * generator.normal(size=values.shape)
    return space_batch(tx, rx, values, stds), target[:, 0]


def without(batch, *names):
    """Return the batch without the elevations of ``dod`` or ``doa``."""
    import dataclasses

    nothing = np.full(batch.dod_rad.shape, np.nan, order="F")
    return dataclasses.replace(
        batch, **{f"{name}_{part}": nothing for name in names for part in ("elevation_rad", "elevation_std_rad")}
    )


def draw_joint_room(generator, snapshots, *, receivers=3, paths=4, degrees=1.0, length_std_m=0.1, blocked=0.0):
    """Return a batch, its indirect paths (B, K), and targets (B, 3).

    Each receiver resolves the ``paths`` shortest of the 49 paths over the target with at most one bounce off a wall,
    the floor or the ceiling before it, and one behind it; a share ``blocked`` of the direct ones is missing.
    """
    tx, rx, target = (SIDES_M * generator.uniform(0.05, 0.95, (snapshots, count, 3)) for count in (1, receivers, 1))
    images = np.repeat(target, 7, axis=1)
    for wall in range(6):
        axis, side = divmod(wall, 2)
        images[:, wall + 1, axis] = 2.0 * side * SIDES_M[axis] - images[:, wall + 1, axis]
    first, second = np.divmod(np.arange(49), 7)
    node_tx = np.broadcast_to(tx[:, :, None], (snapshots, receivers, 49, 3))
    node_rx = np.broadcast_to(rx[:, :, None], (snapshots, receivers, 49, 3))
    values = predict(node_tx, node_rx, images[:, None, first], images[:, None, second])
    length = values[2].copy()
    length[..., 0] = np.where(generator.random((snapshots, receivers)) < blocked, np.inf, length[..., 0])
    chosen = np.argsort(length, axis=2, kind="stable")[..., :paths]
    values = np.take_along_axis(values, chosen[None], axis=3).reshape(5, snapshots, -1)
    angle = np.radians(degrees)
    stds = (angle, angle, length_std_m, angle, angle)
    values = values + np.array(stds)[:, None, None] * generator.normal(size=values.shape)
    count = receivers * paths
    nodes = np.repeat(tx, count, axis=1), np.repeat(rx, paths, axis=1)
    return space_batch(*nodes, values, stds), (chosen > 0).reshape(snapshots, -1), target[:, 0]
