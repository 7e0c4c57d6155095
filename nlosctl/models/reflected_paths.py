"""Paths from a transmitter over objects to a receiver: the triplet that they should read."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["ObjectPaths", "trace_over_objects"]


@dataclass(frozen=True)
class ObjectPaths:
    """Noise-free triplets (N,), angles in the global frame in (-pi, pi], and the legs (N, legs) in metres."""

    dod_rad: FloatArray
    doa_rad: FloatArray
    path_length_m: FloatArray
    legs_m: FloatArray


def trace_over_objects(tx_xy_m: FloatArray, rx_xy_m: FloatArray, objects_xy_m: FloatArray) -> ObjectPaths:
    """Return paths from tx (N, 2) over objects (N, H, 2), in their order, to rx (N, 2); point scatterers, metres.

    With one object, the target, the path is direct; an object more, before or after it, makes it indirect
    (Section II of Shen, Molisch 2012).
    """
    size = objects_xy_m.shape[0]
    ends = [np.broadcast_to(end, (size, 2)) for end in (tx_xy_m, rx_xy_m)]
    points = [ends[0], *(objects_xy_m[:, h] for h in range(objects_xy_m.shape[1])), ends[1]]
    steps = [after - before for before, after in pairwise(points)]
    legs = np.stack([np.hypot(step[:, 0], step[:, 1]) for step in steps], axis=1)
    length = legs[:, 0]
    for leg in range(1, legs.shape[1]):
        length = length + legs[:, leg]
    return ObjectPaths(
        dod_rad=np.arctan2(steps[0][:, 1], steps[0][:, 0]),
        doa_rad=np.arctan2(-steps[-1][:, 1], -steps[-1][:, 0]),
        path_length_m=length,
        legs_m=legs,
    )
