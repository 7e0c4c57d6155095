"""How much likelier a candidate's echoes are to come from one target than to be clutter."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.solvers.echoes.candidates import Candidates
from nlosctl.solvers.echoes.echoes import Echoes

__all__ = ["clutter_density", "target_weights"]


def clutter_density(echoes: Echoes, bandwidth_m: float) -> FloatArray:
    """Return the density (N, M) of echoes per metre and sensor at each echo: all ranges pooled, a Gaussian kernel.

    The kernel is reflected at zero, where no range can be. NaN where there is no echo.
    """
    pooled = echoes.range_m[np.isfinite(echoes.range_m)]
    here = echoes.range_m[..., None]
    kernel = np.exp(-0.5 * ((here - pooled) / bandwidth_m) ** 2) + np.exp(-0.5 * ((here + pooled) / bandwidth_m) ** 2)
    density: FloatArray = kernel.sum(axis=-1) / (np.sqrt(2.0 * np.pi) * bandwidth_m * echoes.sensors)
    return density


def target_weights(
    echoes: Echoes,
    candidates: Candidates,
    *,
    density: FloatArray,
    area_m2: float,
    detection_probability: float,
    reward: float,
) -> FloatArray:
    """Return the log of the likelihood ratio (C,) of a target against clutter, in nats.

    sum of -ln(density sqrt(2 pi) std) over the echoes taken, less half the chi-square, plus ln(2 pi / (sqrt det
    F area)) for a position that could be anywhere in the area, plus ``reward``; and for each sensor the log of the
    probability with which it sees a target, or doesn't.
    """
    seen = candidates.echo >= 0
    place = np.where(seen, candidates.echo, 0)
    sensor = np.broadcast_to(np.arange(echoes.sensors), place.shape)
    surprise = -np.log(density[sensor, place] * np.sqrt(2.0 * np.pi) * echoes.std_m[sensor, place])
    detected = np.where(seen, surprise + np.log(detection_probability), np.log1p(-detection_probability))
    volume = np.log(2.0 * np.pi / area_m2) - 0.5 * np.log(candidates.information.determinant)
    weights: FloatArray = detected.sum(axis=1) - 0.5 * candidates.chi_square + volume + reward
    return weights
