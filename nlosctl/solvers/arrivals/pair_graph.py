"""Independent differences of pairs of sensors as a graph: the places of sensors are its nodes, differences its edges.

The potentials p of the nodes that minimize the sum of ((p_i - p_j - t) / s)^2, (L + e I) p = B'W t with the weighted
Laplacian L = B'WB, are arrivals with one offset for each connected part of the graph: a tiny e holds each part's sum at
zero. If the graph is connected, closed forms for arrivals give initial estimates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.models.arrivals import ArrivalRows

__all__ = ["arrivals_of_pairs", "number_places"]

_RIDGE = 1e-9
"""The e above as a share of the largest diagonal entry of L."""

_OTHER_PART = 1e-3
"""Nodes with less than this share of the mean indicator of the first node's part are in another part."""


def number_places(rows: ArrivalRows) -> IntArray:
    """Return the number (B, 2 K) of the place of each sensor and reference: from 0 in each snapshot, without gaps."""
    shape = rows.sensor[0].shape
    snapshot = np.repeat(np.arange(shape[0], dtype=np.float64), shape[1])
    keys = [*(part.ravel() for part in rows.sensor), *([] if rows.height is None else [rows.height.ravel()]), snapshot]
    order = np.lexsort(keys)
    begins = np.zeros(order.shape, dtype=bool)
    for key in keys:
        begins |= np.diff(key[order], prepend=np.nan) != 0.0
    number = np.empty(order.shape, dtype=np.int64)
    number[order] = np.cumsum(begins)
    number = number.reshape(shape)
    return np.asarray(number - number.min(axis=1, keepdims=True))


def arrivals_of_pairs(rows: ArrivalRows, place: IntArray) -> tuple[ArrivalRows, BoolArray]:
    """Return arrivals (B, N) at the ``place`` (B, 2 K) of sensors and references, and which graphs (B,) are connected.

    All snapshots have N different places. An arrival counts with the weight of its differences.
    """
    snapshots, count, nodes = place.shape[0], rows.arrival_m.shape[1], int(place.max()) + 1
    every, own, other = np.arange(snapshots)[:, None], place[:, :count], place[:, count:]
    weight = np.where(own == other, 0.0, 1.0 / (rows.std_m * rows.std_m))
    laplacian, pull = np.zeros((snapshots, nodes, nodes)), np.zeros((snapshots, nodes, 2))
    for one, two, sign in ((own, other, 1.0), (other, own, -1.0)):
        np.add.at(laplacian, (every, one, one), weight)
        np.add.at(laplacian, (every, one, two), -weight)
        np.add.at(pull[..., 0], (every, one), sign * weight * rows.arrival_m)
    precision = np.einsum("bii->bi", laplacian).copy()
    largest = precision.max(axis=1)
    ridge = _RIDGE * np.where(largest > 0.0, largest, 1.0)  # 0 without a difference of two places
    laplacian[:, np.arange(nodes), np.arange(nodes)] += ridge[:, None]
    pull[:, 0, 1] = ridge
    potential = np.linalg.solve(laplacian, pull)
    connected = np.asarray((potential[..., 1] * nodes > _OTHER_PART).all(axis=1))
    return replace(
        rows,
        sensor=tuple(_by_place(part, place) for part in rows.sensor),
        height=None if rows.height is None else _by_place(rows.height, place),
        arrival_m=np.asfortranarray(potential[..., 0]),
        std_m=np.asfortranarray(1.0 / np.sqrt(precision + ridge[:, None])),
    ), connected


def _by_place(values: FloatArray, place: IntArray) -> FloatArray:
    """Return values (B, 2 K) of sensors and references by the number of their place (B, N)."""
    ordered = np.zeros((place.shape[0], int(place.max()) + 1))
    np.put_along_axis(ordered, place, values, axis=1)
    return np.asfortranarray(ordered)
