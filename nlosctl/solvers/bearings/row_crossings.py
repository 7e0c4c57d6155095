"""Where two rows of bearings cross: in the plane, in space, or on the earth."""

from __future__ import annotations

from nlosctl.arrays import IntArray
from nlosctl.models.bearings import SightLines
from nlosctl.models.space.geodesic_lines import GeodesicLines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.geodesic_row_terms import cross_geodesics
from nlosctl.solvers.bearings.ray_crossings import Candidates, cross_rays
from nlosctl.solvers.bearings.space_crossings import cross_in_space

__all__ = ["cross_rows"]


def cross_rows(lines: SightLines | SpaceLines | GeodesicLines, first: IntArray, second: IntArray) -> Candidates:
    """Return the crossings of pairs of rows; ``first`` and ``second`` are (P,), alike for all snapshots, or (B, P)."""
    if isinstance(lines, SpaceLines):
        return cross_in_space(lines, first, second)
    if isinstance(lines, GeodesicLines):
        return cross_geodesics(lines, first, second)
    return cross_rays(lines, first, second)
