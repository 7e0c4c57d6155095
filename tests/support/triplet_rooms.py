"""Rooms of triplets beyond the scenario's: several targets, extended targets, and clutter alone."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import TripletBatch

HALF_M = np.array([5.0, 4.0])
"""Half the sides of the room of the scenario ``room``."""

ANGLE_STD_RAD, LENGTH_STD_M = np.radians(1.0), 0.1


def batch_of_paths(generator, tx, rx, dod, doa, length, **fields):
    """Return the batch of noise-free triplets (B, K) with errors of 1 degree and 0.1 m."""
    shape = dod.shape
    values = {
        "tx_xy_m": tx,
        "rx_xy_m": rx,
        "dod_rad": dod + ANGLE_STD_RAD * generator.normal(size=shape),
        "doa_rad": doa + ANGLE_STD_RAD * generator.normal(size=shape),
        "path_length_m": np.abs(length + LENGTH_STD_M * generator.normal(size=shape)),
        "dod_std_rad": np.full(shape, ANGLE_STD_RAD),
        "doa_std_rad": np.full(shape, ANGLE_STD_RAD),
        "path_length_std_m": np.full(shape, LENGTH_STD_M),
        **fields,
    }
    arrays = {name: np.asfortranarray(value) for name, value in values.items()}
    return TripletBatch(seed=np.zeros(shape[0], dtype=np.uint64), **arrays)


def draw_room(generator, snapshots, *, targets=1, receivers=3, paths=4, radius_m=0.0):
    """Return a batch, its indirect paths (B, K) and targets (B, T, 2), by the image method.

    Each receiver resolves the ``paths`` shortest of the 25 paths over each target with at most one wall bounce before
    and one behind it. Each path meets its target at a point of its own, ``radius_m`` from the centre.
    """
    tx, rx, target = (
        generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, (snapshots, count, 2)) for count in (1, receivers, targets)
    )
    first, second = np.divmod(np.arange(25), 5)
    blocks = []
    for one in range(targets):
        turn = generator.uniform(-np.pi, np.pi, (snapshots, receivers, 25))
        point = target[:, one, None, None] + radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        departing = images(point, first) - tx[:, :, None]
        arriving = images(point, second) - rx[:, :, None]
        length = np.hypot(*np.moveaxis(departing, -1, 0)) + np.hypot(*np.moveaxis(arriving, -1, 0))
        shortest = np.argsort(length, axis=2, kind="stable")[:, :, :paths]
        triplet = (
            np.arctan2(*np.moveaxis(departing[..., ::-1], -1, 0)),
            np.arctan2(*np.moveaxis(arriving[..., ::-1], -1, 0)),
            length,
        )
        blocks.append([*(np.take_along_axis(part, shortest, axis=2) for part in triplet), shortest > 0])
    dod, doa, length, indirect = (
        np.concatenate(parts, axis=2).reshape(snapshots, -1) for parts in zip(*blocks, strict=True)
    )
    count = dod.shape[1]
    rx = np.repeat(rx, count // receivers, axis=1)
    return batch_of_paths(generator, np.repeat(tx, count, axis=1), rx, dod, doa, length), indirect, target


def images(point, leg):
    """Return points (..., 25, 2) seen over leg 0 (straight) or the wall 1 to 4 (west, east, south, north)."""
    seen = point.copy()
    for wall, (axis, side) in enumerate(((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)), 1):
        over = leg == wall
        seen[..., over, axis] = 2.0 * side * HALF_M[axis] - point[..., over, axis]
    return seen


def draw_clutter(generator, snapshots, paths):
    """Return a batch of paths of one transmitter and three receivers that have nothing in common."""
    tx = np.repeat(generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, (snapshots, 1, 2)), paths, axis=1)
    rx = generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, (snapshots, 3, 2))[:, np.arange(paths) % 3]
    dod, doa = generator.uniform(-np.pi, np.pi, (2, snapshots, paths))
    length = np.hypot(*np.moveaxis(rx - tx, -1, 0)) + generator.exponential(5.0, (snapshots, paths))
    return batch_of_paths(generator, tx, rx, dod, doa, length)


def draw_lone_scatterers(generator, snapshots, paths):
    """Return a batch of paths, each over a scatterer of its own."""
    tx = np.repeat(generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, (snapshots, 1, 2)), paths, axis=1)
    rx = generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, (snapshots, 3, 2))[:, np.arange(paths) % 3]
    scatterer = generator.uniform(-0.9 * HALF_M, 0.9 * HALF_M, tx.shape)
    departing, arriving = scatterer - tx, scatterer - rx
    length = np.hypot(*np.moveaxis(departing, -1, 0)) + np.hypot(*np.moveaxis(arriving, -1, 0))
    dod, doa = (np.arctan2(ray[..., 1], ray[..., 0]) for ray in (departing, arriving))
    return batch_of_paths(generator, tx, rx, dod, doa, length)
