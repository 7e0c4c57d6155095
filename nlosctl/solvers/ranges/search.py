"""Where the likelihood of ranges has its optima: descents from the crossings of circles, and the two best ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.circles import cross_circles
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.models.ranges.spheres import RangeRows, RangeSpheres
from nlosctl.solvers.optimization.polar_coordinates import Pole, minimize_about_pole
from nlosctl.solvers.optimization.problem import Problem
from nlosctl.solvers.optimization.two_optima import End, Landscape, TwoBest
from nlosctl.solvers.ranges.space_search import find_space_optima
from nlosctl.solvers.ranges.squared_ranges import SquaredRangeFit

__all__ = ["cross_pairs", "every_pair", "find_range_optima", "find_two_optima", "surest_pairs", "surest_pole"]

_EVERY_CROSSING = 4
"""Up to this many rows a descent starts from every crossing; of more rows one descent, from the likeliest other one."""

_PARTNERS = 4
"""So many of the farthest sensors have their circles crossed with that of the surest range, if there are more rows."""

_EXPLAINED, _EXPLAINED_IF_THOROUGH = 0.3, 0.6
"""A point leads to a known optimum if its cost is at least this share of what the quadratic model there predicts."""


def find_range_optima(problem: Problem, rows: RangeRows, fit: SquaredRangeFit, max_iterations: int) -> tuple[End, End]:
    """Return the two best optima of ``problem``, a cost of ``circles``, as `find_two_optima`.

    The first descent starts from the squared-range fit. The other points are the fit's mirror image and the crossings
    of all circles, of more than four rows those with the circle of the surest range. In space `find_space_optima`.
    """
    if isinstance(rows, RangeSpheres):
        return find_space_optima(problem, rows, fit, max_iterations)
    few = rows.range_m.shape[1] <= _EVERY_CROSSING
    x, y = cross_pairs(rows, *(every_pair(rows) if few else surest_pairs(rows)))
    points = np.concatenate([[fit.mirror[0]], x]), np.concatenate([[fit.mirror[1]], y])
    pole = surest_pole(rows)
    return find_two_optima(problem, rows, pole, (fit.point[0], fit.point[1]), points, max_iterations, thorough=few)


def find_two_optima(
    problem: Problem,
    landscape: Landscape,
    pole: Pole,
    start: tuple[FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray],
    max_iterations: int,
    *,
    thorough: bool,
) -> tuple[End, End]:
    """Return the two best optima of ``problem``, a cost of the ``landscape``, the second NaN where there is only one.

    The first descent is from ``start`` (B,). Further ones start from the likeliest of ``points`` (P, B) that does not
    lead to a known optimum: if ``thorough`` as long as there is one, else one.
    """
    x, y = points
    cost = landscape.half_chi_squares(x.T, y.T).T
    open_points = np.isfinite(cost)
    rows = np.arange(cost.shape[1])
    rounds, share = (cost.shape[0], _EXPLAINED_IF_THOROUGH) if thorough else (1, _EXPLAINED)
    end = _descend(problem, pole, *start, max_iterations)
    optima = TwoBest(end)
    for _ in range(rounds):
        there, poles = (landscape, pole) if rows.size == cost.shape[1] else (landscape.take(rows), pole.take(rows))
        information = there.information(end.x, end.y)
        optima.note(rows, end, information)
        half_chi_square = there.half_chi_squares(end.x[:, None], end.y[:, None])[:, 0]
        known = _Optimum(poles, end, information, half_chi_square)
        still = open_points[:, rows] & ~known.explains(x[:, rows], y[:, rows], cost[:, rows], share)
        open_points[:, rows] = still
        rows = rows[still.any(axis=0)]
        if not rows.size:
            return optima.best, optima.other
        index = np.argmin(np.where(open_points[:, rows], cost[:, rows], np.inf), axis=0)
        open_points[index, rows] = False
        end = _descend(problem.take(rows), pole.take(rows), x[index, rows], y[index, rows], max_iterations)
    optima.note(rows, end, landscape.take(rows).information(end.x, end.y))
    return optima.best, optima.other


def surest_pole(circles: RangeCircles) -> Pole:
    """Return the sensors of the surest ranges as poles, with their ranges (not below their std) as radii."""
    snapshot, row = np.arange(circles.range_m.shape[0]), np.argmin(circles.std_m, axis=1)
    at = snapshot, row
    radius = np.sqrt(np.maximum(circles.squared_in_plane()[at], circles.std_m[at] ** 2))
    return Pole(circles.sensor_x[at], circles.sensor_y[at], radius)


def cross_pairs(circles: RangeCircles, first: IntArray, second: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return x and y (2 P, B) of both crossings of pairs of circles, rows (P,) or (B, P).

    NaN where circles are concentric; the middle of their closest approach, once, where they do not cross. Slant ranges
    shorter than the height count as of their std in the plane.
    """
    radius = np.sqrt(np.maximum(circles.squared_in_plane(), circles.std_m * circles.std_m))
    center = np.stack([circles.sensor_x, circles.sensor_y], axis=-1)
    snapshot = slice(None) if first.ndim == 1 else np.arange(radius.shape[0])[:, None]
    one, other = (snapshot, first), (snapshot, second)
    points = cross_circles(center[one], radius[one], center[other], radius[other], gap_tolerance=np.inf)
    x, y = (np.concatenate([points[..., 0, axis], points[..., 1, axis]], axis=1).T for axis in (0, 1))
    return x, y


def every_pair(circles: RangeCircles) -> tuple[IntArray, IntArray]:
    """Return all pairs of rows (P,)."""
    first, second = np.triu_indices(circles.range_m.shape[1], 1)
    return first.astype(np.int64), second.astype(np.int64)


def surest_pairs(circles: RangeCircles) -> tuple[IntArray, IntArray]:
    """Return the row (B, P) of the surest range, and the rows of the sensors farthest from its own."""
    surest = np.argmin(circles.std_m, axis=1)
    pole = surest_pole(circles)
    dx, dy = circles.sensor_x - pole.x[:, None], circles.sensor_y - pole.y[:, None]
    partner = np.argsort(-(dx * dx + dy * dy), axis=1, kind="stable")[:, :_PARTNERS]
    return np.broadcast_to(surest[:, None], partner.shape), partner


def _descend(problem: Problem, pole: Pole, x: FloatArray, y: FloatArray, max_iterations: int) -> End:
    end = minimize_about_pole(problem, pole, x, y, max_iterations=max_iterations)
    return End(end.point, end.cost, end.converged)


class _Optimum(NamedTuple):
    """Optima (B,), their information, and half the chi-square there."""

    pole: Pole
    end: End
    information: SymmetricMatrix
    half_chi_square: FloatArray

    def explains(self, x: FloatArray, y: FloatArray, cost: FloatArray, share: float) -> BoolArray:
        """Return which points (C, B) lead to the optimum: those whose cost is about what its quadratic model predicts.

        The model is that in polar coordinates, in which the valley is straight.
        """
        pole, end = self.pole, self.end
        distance, arc = pole.polar(end.x, end.y)
        away, turned = pole.polar(x, y)
        with ignoring_invalid():
            out_x, out_y = (end.x - pole.x) / distance, (end.y - pole.y) / distance
            away -= distance
            turned = distance * wrap_angle((turned - arc) / pole.radius_m)
            step = away * out_x - turned * out_y, away * out_y + turned * out_x
            predicted = 0.5 * self.information.quadratic_form(*step)
            explained: BoolArray = cost - self.half_chi_square >= share * predicted
        return explained & end.converged
