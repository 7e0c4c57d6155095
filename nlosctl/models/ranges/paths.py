"""Paths of ranges: their length and how it changes with the position of the source."""

from __future__ import annotations

from typing import NamedTuple

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["FAR_OFF", "BentPaths", "RangePath"]

FAR_OFF = 1e3
"""So many standard deviations the range is too short for a point to which its row has no path."""


class RangePath(NamedTuple):
    """Paths: length, its gradient u as D arrays, and the radius of the wave front.

    The second derivatives are (I - u u') / radius. For slant ranges the radius is the length.
    """

    length_m: FloatArray
    along: tuple[FloatArray, ...]
    radius_m: FloatArray

    @property
    def along_x(self) -> FloatArray:
        """The derivative by the first coordinate."""
        return self.along[0]

    @property
    def along_y(self) -> FloatArray:
        """The derivative by the second coordinate."""
        return self.along[1]


class BentPaths(NamedTuple):
    """The paths by a circle of the snapshots (n,) in which a measurement has one.

    The length is NaN, all else finite, where no path leads to the point.
    """

    snapshot: IntArray
    path: RangePath
