"""How surely a path is measured: signal-to-noise ratio and standard deviations of Shen, Molisch 2012, Section VI-A."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division

__all__ = ["signal_to_noise", "triplet_standard_deviations"]


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
