"""Independent differences of pairs of sensors as a graph: sensors are its nodes, differences its edges.

The potentials p of the nodes that minimize the sum of ((p_i - p_j - t) / s)^2, (L + e I) p = B'W t with the weighted
Laplacian L = B'WB, are arrivals with one offset for each connected part of the graph: a tiny e holds each part's sum at
zero. If the graph is connected, closed forms for arrivals give initial estimates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.models.arrivals import ArrivalRows

__all__ = ["arrivals_of_pairs"]

_RIDGE = 1e-9
"""The e above as a share of the largest diagonal entry of L."""

_OTHER_PART = 1e-3
"""Nodes with less than this share of the mean indicator of the first node's part are in another part."""

_ABSENT = 1e9
"""The std of nodes that a snapshot does not have, in those of its largest."""


def arrivals_of_pairs(rows: ArrivalRows) -> tuple[ArrivalRows, BoolArray]:
    """Return arrivals (B, 2 K) at the distinct places of sensors and references, and which graphs (B,) are connected.

    Each counts with the weight of its differences; a snapshot with fewer places has others without weight.
    """
    place = _places(rows)
    every, count = np.arange(place.shape[0])[:, None], rows.arrival_m.shape[1]
    own, other = place[:, :count], place[:, count:]
    weight = 1.0 / (rows.std_m * rows.std_m)
    laplacian = np.zeros((*place.shape, place.shape[1]))
    pull = np.zeros((*place.shape, 2))
    for one, two, sign in ((own, other, 1.0), (other, own, -1.0)):
        np.add.at(laplacian, (every, one, one), weight)
        np.add.at(laplacian, (every, one, two), -weight)
        np.add.at(pull[..., 0], (every, one), sign * weight * rows.arrival_m)
    precision = np.einsum("bii->bi", laplacian).copy()
    ridge = _RIDGE * precision.max(axis=1)
    laplacian[:, np.arange(place.shape[1]), np.arange(place.shape[1])] += ridge[:, None]
    pull[:, 0, 1] = ridge
    potential = np.linalg.solve(laplacian, pull)
    is_there = precision > 0.0
    share = potential[..., 1] * is_there.sum(axis=1)[:, None]
    connected: BoolArray = (~is_there | (share > _OTHER_PART)).all(axis=1)
    absent = _ABSENT * rows.std_m.max(axis=1)[:, None]
    std = np.where(is_there, 1.0 / np.sqrt(np.where(is_there, precision, 1.0)), absent)
    sensor = tuple(_at_places(part, place) for part in rows.sensor)
    height = None if rows.height is None else _at_places(rows.height, place)
    arrival = np.asfortranarray(potential[..., 0])
    return replace(rows, sensor=sensor, height=height, arrival_m=arrival, std_m=np.asfortranarray(std)), connected


def _places(rows: ArrivalRows) -> IntArray:
    """Return the number (B, 2 K), from 0 in each snapshot, of the place of each sensor and reference."""
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
    return np.asarray(number - number.min(axis=1)[:, None])


def _at_places(values: FloatArray, place: IntArray) -> FloatArray:
    """Return values (B, 2 K) of sensors and references in the order of their places, 0 for those that are absent."""
    ordered = np.zeros(values.shape)
    np.put_along_axis(ordered, place, values, axis=1)
    return np.asfortranarray(ordered)
