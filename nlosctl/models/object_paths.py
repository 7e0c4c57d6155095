"""Paths over objects: the triplet that they should read, and how precisely it is measured."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division

__all__ = ["ObjectPaths", "signal_to_noise", "trace_over_objects", "triplet_standard_deviations"]


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


_GAINS_DB = 88.0
"""Antennas and cross-sections over the noise of 1 GHz (-84 dBm), as (37) rounds them."""
_REFLECTOR_LOSS_DB = 0.22


def signal_to_noise(power_dbm: FloatArray | float, legs_m: FloatArray) -> FloatArray:
    """Return the signal-to-noise ratio (N,), as a factor, of paths with legs (N, H + 2) in metres; equation (37).

    H is the number of reflectors besides the target. A leg shorter than 0.28 m counts as a gain, as in the paper.
    """
    reflectors = legs_m.shape[-1] - 2
    decibel = power_dbm + _GAINS_DB - _REFLECTOR_LOSS_DB * reflectors
    for leg in range(legs_m.shape[-1]):
        decibel = decibel - 10.0 * np.log10(4.0 * np.pi * legs_m[..., leg] ** 2)
    return np.asarray(10.0 ** (0.1 * decibel))


def triplet_standard_deviations(
    snr: FloatArray, dod_sine: FloatArray, doa_sine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the standard deviations of DOD, DOA (radians) and path length (metres); equations (38)-(40).

    ``dod_sine`` and ``doa_sine`` are of the angles to the baseline, along which both arrays lie; on it the angles
    are not measured at all (infinite).
    """
    root = np.sqrt(snr)
    with ignoring_division():
        return 0.05 / (np.abs(dod_sine) * root), 0.05 / (np.abs(doa_sine) * root), 0.038 / root
