"""Linear fits of a point to lines, compared with numpy.linalg.lstsq."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.line_fits import fit_least_squares, fit_weighted

FloatArray = npt.NDArray[np.float64]


def random_lines(snapshots: int, measurements: int) -> SightLines:
    """Return rays from random origins, roughly towards a point per snapshot."""
    generator = np.random.default_rng(5)
    shape = (snapshots, measurements)
    origin_x, origin_y = generator.uniform(-1e3, 1e3, (2, *shape))
    target = generator.uniform(-500.0, 500.0, (2, snapshots, 1))
    direction = np.arctan2(target[1] - origin_y, target[0] - origin_x) + generator.normal(0.0, 0.03, shape)
    return SightLines(
        center_x=np.zeros(snapshots),
        center_y=np.zeros(snapshots),
        origin_x=origin_x,
        origin_y=origin_y,
        cosine=np.cos(direction),
        sine=np.sin(direction),
        std_rad=generator.uniform(0.001, 0.1, shape),
        handedness=None,
        mirrors=None,
    )


def fit_by_numpy(lines: SightLines, row: int, weight: FloatArray) -> FloatArray:
    """Return the weighted fit of one snapshot by numpy.linalg.lstsq."""
    normal = np.stack([-lines.sine[row], lines.cosine[row]], axis=1)
    offset = normal[:, 0] * lines.origin_x[row] + normal[:, 1] * lines.origin_y[row]
    return np.linalg.lstsq(weight[:, None] * normal, weight * offset, rcond=None)[0]


def test_least_squares_agrees_with_numpy() -> None:
    """The point nearest to all lines agrees with numpy.linalg.lstsq to 1e-9 of the scene's size."""
    lines = random_lines(200, 6)
    fit = fit_least_squares(lines)
    for row in range(200):
        expected = fit_by_numpy(lines, row, np.ones(6))
        np.testing.assert_allclose([fit.x[row], fit.y[row]], expected, rtol=0, atol=1e-6)


def test_stansfield_is_one_weighted_pass_from_least_squares() -> None:
    """Stansfield is lstsq with weights 1 / (std range) at the ranges of the least-squares fix, not iterated."""
    lines = random_lines(200, 6)
    first = fit_least_squares(lines)
    fit = fit_weighted(lines, lines.stansfield_width_m(*first.point))
    for row in range(200):
        start = fit_by_numpy(lines, row, np.ones(6))
        distance = np.hypot(start[0] - lines.origin_x[row], start[1] - lines.origin_y[row])
        expected = fit_by_numpy(lines, row, 1.0 / (lines.std_rad[row] * distance))
        np.testing.assert_allclose([fit.x[row], fit.y[row]], expected, rtol=0, atol=1e-6)


def test_the_normal_matrix_is_that_of_the_weighted_lines() -> None:
    """``normal`` is A^T A of the fitted rows."""
    lines = random_lines(20, 4)
    normal = fit_least_squares(lines).normal
    rows = np.stack([lines.sine, -lines.cosine], axis=-1)
    expected = np.swapaxes(rows, 1, 2) @ rows
    np.testing.assert_allclose(normal.xx, expected[:, 0, 0], rtol=1e-13)
    np.testing.assert_allclose(normal.xy, expected[:, 0, 1], atol=1e-13)
    np.testing.assert_allclose(normal.yy, expected[:, 1, 1], rtol=1e-13)


def test_parallel_lines_have_no_point() -> None:
    """Exactly parallel lines give values that are not finite in both fits, without a warning."""
    lines = random_lines(2, 3)
    lines.cosine[0], lines.sine[0] = 1.0, 0.0
    first = fit_least_squares(lines)
    second = fit_weighted(lines, lines.stansfield_width_m(*first.point))
    for fit in (first, second):
        assert not np.isfinite([fit.x[0], fit.y[0]]).any()
        assert np.isfinite([fit.x[1], fit.y[1]]).all()
