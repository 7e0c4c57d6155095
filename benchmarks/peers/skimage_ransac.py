"""scikit-image: `skimage.measure.ransac` over the lines of bearing of a snapshot, a linear fix as the model."""

import numpy as np
from rounds import rows, serve
from skimage.measure import ransac

_THRESHOLD_STDS = 2.5
_TRIALS = 56  # twice the pairs of 8 lines


class Fix:
    """The point nearest to the lines; a line's residual is the error of its bearing in standard deviations."""

    def __init__(self, point):
        self.point = point

    @classmethod
    def from_estimate(cls, lines):
        """Return the least-squares point of lines (K, 4) of x, y, bearing and standard deviation."""
        x, y, bearing, _ = lines.T
        a, b = np.sin(bearing), -np.cos(bearing)
        aa, ab, bb, c = a @ a, a @ b, b @ b, a * x + b * y
        determinant = aa * bb - ab * ab
        if determinant < 1e-12:
            return None
        return cls(np.array([bb * (a @ c) - ab * (b @ c), aa * (b @ c) - ab * (a @ c)]) / determinant)

    def residuals(self, lines):
        """Return the errors (K,)."""
        x, y, bearing, std = lines.T
        error = np.arctan2(self.point[1] - y, self.point[0] - x) - bearing
        return np.abs(error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / std


def solve(problems):
    """Return the fixes of all snapshots, NaN where no two lines cross."""
    generator = np.random.default_rng(1)
    fixes = np.full_like(problems["start_m"], np.nan)
    for row, (_, *columns) in enumerate(rows(problems)):
        lines = np.stack(columns, axis=1)
        model, _ = ransac(lines, Fix, 2, _THRESHOLD_STDS, max_trials=_TRIALS, stop_probability=1.0, rng=generator)
        if model is not None:
            fixes[row] = model.point
    return fixes


if __name__ == "__main__":
    serve(solve)
