"""gtsam: a graph of one `CustomFactor` (8 bearings, analytic Jacobian) and a point, Levenberg-Marquardt, `Marginals`.

`BearingFactor2D` makes an unknown of each sensor's pose; with the 8 poses held it takes half as long again, or more.
"""

import gtsam
import numpy as np
from rounds import bearing_errors, rows, serve

_POINT = 0


def solve(problems):
    """Return all fixes; covariances are made too."""
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-9)
    settings.setAbsoluteErrorTol(0.0)
    fixes = np.empty_like(problems["start_m"])
    unit = gtsam.noiseModel.Unit.Create(problems["bearing_rad"].shape[1])
    for row, (start, *columns) in enumerate(rows(problems)):

        def error(_, values, jacobians, columns=columns):
            residual, jacobian = bearing_errors(values.atPoint2(_POINT), *columns)
            if jacobians is not None:
                jacobians[0] = np.asfortranarray(jacobian)
            return residual

        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.CustomFactor(unit, [_POINT], error))
        first = gtsam.Values()
        first.insert(_POINT, start)
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, first, settings)
        values = optimizer.optimize()
        gtsam.Marginals(graph, values).marginalCovariance(_POINT)
        converged = optimizer.iterations() < settings.getMaxIterations()
        fixes[row] = values.atPoint2(_POINT) if converged else np.nan
    return fixes


if __name__ == "__main__":
    serve(solve)
