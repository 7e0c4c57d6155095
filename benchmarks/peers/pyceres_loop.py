"""pyceres: one residual block of 8 bearings with its analytic Jacobian in Python, dense QR, `Covariance`."""

import numpy as np
import pyceres
from rounds import bearing_errors, rows, serve


class Bearings(pyceres.CostFunction):
    """The bearings of a snapshot as a residual block of one point."""

    def __init__(self, columns):
        pyceres.CostFunction.__init__(self)
        self._columns = columns
        self.set_num_residuals(len(columns[0]))
        self.set_parameter_block_sizes([2])

    def Evaluate(self, parameters, residuals, jacobians):  # noqa: N802 (Ceres calls it by this name)
        """Fill in the residuals and, where asked, the Jacobian, row by row."""
        residuals[:], jacobian = bearing_errors(parameters[0], *self._columns)
        if jacobians is not None and jacobians[0] is not None:
            jacobians[0][:] = jacobian.ravel()
        return True


def solve(problems):
    """Return all fixes; covariances are made too."""
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_QR
    options.logging_type = pyceres.LoggingType.SILENT
    options.num_threads = 1
    options.function_tolerance = 1e-11
    uncertainty = pyceres.CovarianceOptions()
    uncertainty.num_threads = 1
    fixes = np.empty_like(problems["start_m"])
    for row, (start, *columns) in enumerate(rows(problems)):
        point = start.copy()
        problem = pyceres.Problem()
        problem.add_residual_block(Bearings(columns), None, [point])
        summary = pyceres.SolverSummary()
        pyceres.solve(options, problem, summary)
        covariance = pyceres.Covariance(uncertainty)
        if covariance.compute([(point, point)], problem):
            covariance.get_covariance_block(point, point)
        fixes[row] = point if summary.termination_type == pyceres.TerminationType.CONVERGENCE else np.nan
    return fixes


if __name__ == "__main__":
    serve(solve)
