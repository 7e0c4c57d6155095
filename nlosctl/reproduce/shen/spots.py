"""Shen, Molisch 2012, Section IV-C: reflectors via which a rule is blind, for a target at (-1, 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.reproduce.shen.detection_theory import ORDERS, DetectionScene, Order

__all__ = ["REGION_M", "SCENE", "SPOTS", "Spot"]

SCENE = DetectionScene(target_m=(-1.0, 5.0))
REGION_M = (-8.0, 8.0, 0.0, 10.0)
_FIRST, _SECOND = ORDERS
_NEAR, _FAR = 0.5, 30.0
"""Smallest distance of a reflector from the node, and length of a half-line before it is cut at the region, metres."""


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A blind spot: reflectors on a line segment, x and y in metres, for paths of one order."""

    kind: str
    order: Order
    from_m: tuple[float, float]
    to_m: tuple[float, float]

    def points(self, along: FloatArray) -> FloatArray:
        """Return the points (N, 2) at shares (N,) of the segment."""
        start, end = np.array(self.from_m), np.array(self.to_m)
        return np.asarray(start + along[:, None] * (end - start))


def _half_line(kind: str, order: Order, node: tuple[float, float], angle: float) -> Spot:
    """Return the part of a half-line from a node inside the region."""
    step = np.array([np.cos(angle), np.sin(angle)])
    along = np.linspace(_NEAR, _FAR, 10_000)
    points = np.array(node) + along[:, None] * step
    x_low, x_high, y_low, y_high = REGION_M
    inside = (points[:, 0] >= x_low) & (points[:, 0] <= x_high) & (points[:, 1] >= y_low) & (points[:, 1] <= y_high)
    last = points[np.flatnonzero(inside)[-1]]
    first = points[0]
    return Spot(
        kind=kind, order=order, from_m=(float(first[0]), float(first[1])), to_m=(float(last[0]), float(last[1]))
    )


def _angle(node: tuple[float, float]) -> float:
    return float(np.arctan2(SCENE.target_m[1] - node[1], SCENE.target_m[0] - node[0]))


_DOD, _DOA = _angle(SCENE.tx_m), _angle(SCENE.rx_m)
_ON_LINES = (
    Spot(kind="BS1", order=_FIRST, from_m=SCENE.tx_m, to_m=SCENE.target_m),
    Spot(kind="BS1", order=_SECOND, from_m=SCENE.rx_m, to_m=SCENE.target_m),
    _half_line("BS1", _SECOND, SCENE.target_m, _DOD),
    _half_line("BS1", _FIRST, SCENE.target_m, _DOA),
)
_PARALLEL = (_half_line("BS2", _FIRST, SCENE.tx_m, _DOA), _half_line("BS2", _SECOND, SCENE.rx_m, _DOD))
_LEVEL_Y = 1e-3

SPOTS: dict[str, tuple[Spot, ...]] = {
    "lambda1": (*_ON_LINES, *_PARALLEL, _half_line("BS3", _FIRST, SCENE.tx_m, 0.5 * np.pi)),
    "lambda2": (
        *_ON_LINES,
        *_PARALLEL,
        Spot(kind="BS3", order=_FIRST, from_m=(SCENE.tx_m[0] - _NEAR, _LEVEL_Y), to_m=(REGION_M[0], _LEVEL_Y)),
    ),
    "lambda3": (*_ON_LINES, *_PARALLEL, _half_line("BS3", _SECOND, SCENE.rx_m, 0.5 * np.pi)),
    "lambda4": (
        *_ON_LINES,
        *_PARALLEL,
        Spot(kind="BS3", order=_SECOND, from_m=(SCENE.rx_m[0] + _NEAR, _LEVEL_Y), to_m=(REGION_M[1], _LEVEL_Y)),
    ),
    "lambda5": _ON_LINES,
    "lambda6": (
        *_ON_LINES,
        _half_line("BS3", _FIRST, SCENE.tx_m, np.pi - _DOA),
        _half_line("BS3", _SECOND, SCENE.rx_m, np.pi - _DOD),
    ),
}
"""Table I for this target: each rule is blind on the lines to the target and on spots of its own."""
