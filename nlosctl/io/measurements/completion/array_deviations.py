"""Bearings of arrays whose deviation depends on the direction relative to their heading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.calibration import Calibration
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError
from nlosctl.geometry.angles import deviation, direction_without_deviation, wrap_angle
from nlosctl.io.measurements.completion.sensor_keys import sensor_texts

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["HEADING", "DeviatedRows", "deviated_rows", "sector_of", "with_headings"]

HEADING = "heading_rad"
"""The column with the heading of each row, clockwise from +y in radians."""


class DeviatedRows:
    """Bearings (N,) by the terms (N, T) of their arrays, in radians.

    ``direction`` is the bearing relative to the heading, counter-clockwise and without its deviation, ``value`` the
    deviation and ``slope`` its derivative.
    """

    def __init__(self, bearing_rad: FloatArray, heading_rad: FloatArray, terms: FloatArray) -> None:
        relative = wrap_angle(bearing_rad - (0.5 * np.pi - np.nan_to_num(heading_rad)))
        self.direction = direction_without_deviation(relative, terms)
        self.value, self.slope = deviation(self.direction, terms)


def deviated_rows(columns: Mapping[str, npt.NDArray[Any]], terms: FloatArray) -> tuple[dict[str, Any], DeviatedRows]:
    """Return the columns (N,) without the deviations by the terms (N, T), and these.

    An error of the measurement moves the bearing without deviation by 1 / (1 + slope) of it, and so do the stds.
    """
    rows = DeviatedRows(columns["bearing_rad"], columns[HEADING], terms)
    changed = {**columns, "bearing_rad": columns["bearing_rad"] - rows.value}
    for name in ("bearing_std_rad", "direction_std_rad"):
        if name in changed:
            changed[name] = changed[name] / (1.0 + rows.slope)
    return changed, rows


def sector_of(direction_rad: FloatArray, sectors: int) -> IntArray:
    """Return the sector (N,) of a turn, from -pi, that a direction (N,) is in."""
    turn = (wrap_angle(direction_rad) + np.pi) / (2.0 * np.pi)
    return np.minimum((turn * sectors).astype(np.int64), sectors - 1)


def with_headings(chunk: Chunk, scene: Scene, calibration: Calibration) -> Chunk:
    """Return the chunk with the heading of each row, from its column or the scene.

    Raises DataError for a row without one whose deviation the calibration has, or estimates.
    """
    if HEADING in chunk.columns:
        return chunk
    codes, names = sensor_texts(chunk)
    own = np.full(codes.shape, np.nan) if "heading_deg" not in chunk.columns else chunk.columns["heading_deg"]
    heading_deg = np.where(np.isnan(own), _headings_in(scene, names)[codes], own)
    needed = ~chunk.left_out & _has_deviation(codes, names, calibration)
    if (needed & np.isnan(heading_deg)).any():
        name = names[codes[needed & np.isnan(heading_deg)][0]]
        raise DataError(
            f"{chunk.source or 'the input'}: no heading of {name!r}: deviations that depend on the direction need the "
            "heading of every row; add a column 'heading_deg' (clockwise from +y), or heading_deg of the sensor in the "
            "scene"
        )
    return replace(chunk, columns={**chunk.columns, HEADING: np.radians(heading_deg)})


def _has_deviation(codes: IntArray, names: Sequence[str], calibration: Calibration) -> BoolArray:
    """Return which rows (N,) are of a sensor with an entry in the calibration; all without any entry."""
    known = {entry.name for entry in calibration.entries}
    return np.array([not known or name in known for name in names], dtype=bool)[codes]


def _headings_in(scene: Scene, names: Sequence[str]) -> FloatArray:
    """Return the headings of sensors in the scene, in degrees, NaN without one or with several."""
    found = {name: {known.heading_deg for known in scene.sensors if known.name == name} for name in names}
    one = [next(iter(found[name])) if len(found[name]) == 1 else None for name in names]
    return np.array([np.nan if heading is None else heading for heading in one], dtype=np.float64)
