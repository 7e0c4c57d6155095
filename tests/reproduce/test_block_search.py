"""The search of a fine grid by blocks, for the circular figure of Song, Willett and Zhou."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.models.bearings import sight_lines
from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.simulated import batch_of, fixes, simulated
from nlosctl.reproduce.song.block_search import search_blocks
from nlosctl.reproduce.song.fig9 import _grid_errors
from nlosctl.solvers.bearings.grid_search import search_grid
from nlosctl.solvers.bearings.line_fits import fit_least_squares

GRID = {"width_m": 160e3, "height_m": 200e3, "step_m": 1e3}


@pytest.mark.parametrize("parameter_set", ["a", "b"])
@pytest.mark.parametrize("epsilon_deg", [0.1, 1.5, 5.0])
@pytest.mark.parametrize("about", ["fix", "truth"])
def test_the_best_vertex_is_that_of_all_vertices(parameter_set: str, epsilon_deg: float, about: str) -> None:
    """The same vertex, to the bit, as a look at each of the 161 x 201, with half of the evaluations at most."""
    chunk = Chunk(seed=7, number=0, first=0, size=4, total=4)
    trials = simulated("song-circle", chunk, parameter_set=parameter_set, bearing_std_deg=epsilon_deg)
    lines = sight_lines(batch_of(trials))
    x, y = trials.truth_m[:, 0] - lines.center_x, trials.truth_m[:, 1] - lines.center_y
    if about == "fix":
        first = fit_least_squares(lines)
        x, y = first.x, first.y
    blocks, every = search_blocks(lines, x, y, **GRID), search_grid(lines, x, y, **GRID)
    for name in ("x", "y", "cost", "exists", "at_boundary"):
        np.testing.assert_array_equal(getattr(blocks, name), getattr(every, name))
    assert blocks.evaluations.sum() < 0.5 * every.evaluations.sum()


def test_the_errors_are_those_of_the_method() -> None:
    """The figure's errors are those of ``ml-grid`` with the paper's grid, NaN where it has no position."""
    chunk = Chunk(seed=9, number=0, first=0, size=6, total=6)
    trials = simulated("song-circle", chunk, parameter_set="b", bearing_std_deg=5.0)
    expected = fixes(trials, chunk, "ml-grid", **GRID).error_m
    np.testing.assert_allclose(_grid_errors(trials, GRID)[0], expected, rtol=1e-12)
