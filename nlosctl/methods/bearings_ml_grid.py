"""Maximum likelihood on bearings by a grid search about the least-squares fix: the slow reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.grid_search import GridBest, search_grid
from nlosctl.solvers.bearings.line_fits import fit_least_squares

__all__ = ["METHOD", "GridOptions", "finish_grid_fix", "solve"]


@dataclass(frozen=True, kw_only=True)
class GridOptions:
    """Parameters of ``ml-grid``."""

    width_m: float = option(160e3, unit="m", minimum=0.0, exclusive=True, meaning="size of the search region along x")
    height_m: float = option(200e3, unit="m", minimum=0.0, exclusive=True, meaning="size of the search region along y")
    step_m: float = option(1e3, unit="m", minimum=0.0, exclusive=True, meaning="distance between vertices of the grid")
    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


def solve(batch: BearingBatch, options: GridOptions) -> Solution:
    """Solve a batch by the grid search of Song, Willett, Zhou 2013, Sections 3.3 and 5.2.

    The vertex with the least half chi-square among those of the field about the least-squares fix that the scene
    allows: ``boundary`` where it is on the field's edge, ``no_candidate`` where the scene allows none. The covariance
    is the inverse Fisher information at the vertex; the grid's own step is not in it. Raises UsageError for a grid of
    more vertices than the limit ``grid_vertices``.
    """
    vertices = (options.width_m / options.step_m + 1.0) * (options.height_m / options.step_m + 1.0)
    if vertices > limit("grid_vertices"):
        raise UsageError(
            f"method 'ml-grid': width_m, height_m and step_m make {vertices:.3g} vertices, more than "
            f"{limit('grid_vertices')}; {refusal_hint('grid_vertices')}"
        )
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    best = search_grid(
        lines, first.x, first.y, width_m=options.width_m, height_m=options.height_m, step_m=options.step_m
    )
    return finish_grid_fix(batch, lines, best, first.normal, options.min_range_m)


def finish_grid_fix(
    batch: BearingBatch, lines: SightLines, best: GridBest, normal: SymmetricMatrix, min_range_m: float
) -> Solution:
    """Return the solution of the best vertices about least-squares fixes with the normal matrices ``normal`` (B,)."""
    constrained_status: npt.NDArray[np.uint8] = np.where(best.at_boundary, Status.BOUNDARY, Status.OK).astype(np.uint8)
    constrained_status[~best.exists] = Status.NO_CANDIDATE
    return finish_bearings_fix(
        batch, lines, (best.x, best.y), None, normal, min_range_m=min_range_m, constrained_status=constrained_status
    )


METHOD = MethodSpec(
    name="ml-grid",
    kind="bearings",
    job="localize",
    summary="maximum likelihood by grid search about the least-squares fix: slow, a reference for ml",
    reference="Song, Willett, Zhou 2013, Sections 3.3 and 5.2, equation (35)",
    options=GridOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m"},
    exempt_from=frozenset({"frame"}),
)
