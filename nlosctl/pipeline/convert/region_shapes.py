"""Highest-density regions of a posterior map, as polygons on the earth for an exporter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import Shapes
from nlosctl.errors import DataError
from nlosctl.geometry.antimeridian import crosses_antimeridian, cut_ring, rings_by_polygon
from nlosctl.geometry.earth import EarthPlane
from nlosctl.pipeline.convert.cell_outlines import cell_outlines
from nlosctl.pipeline.convert.map_shapes import Columns, Numbers, Planes

__all__ = ["by_snapshot", "has_posterior_cells", "posterior_regions"]

_LEVELS = (0.5, 0.9, 0.95)
_ROUNDING = 1e-12


def has_posterior_cells(names: Sequence[str]) -> bool:
    """Return whether columns are those of posterior maps."""
    return {"x_m", "y_m", "probability", "hpd"} <= set(names)


def by_snapshot(table: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the id of each snapshot's rows in a table and those rows; None for a map without."""
    if "snapshot" not in table.column_names:
        yield None, table
        return
    names = table.column("snapshot").to_pylist()
    starts = [0, *(row for row in range(1, len(names)) if names[row] != names[row - 1]), len(names)]
    for start, end in pairwise(starts):
        yield names[start], table.slice(start, end - start)


def posterior_regions(columns: Columns, snapshot: Any, numbers: Numbers, planes: Planes, *, metres: bool) -> Shapes:
    """Return the smallest regions of cells that hold 50, 90 and 95 % of a complete map; DataError without a grid."""
    x, y, probability, hpd = (numbers(columns[name], name) for name in ("x_m", "y_m", "probability", "hpd"))
    across, along = np.unique(x), np.unique(y)
    if across.size * along.size != x.size or x.size < 4:
        raise DataError("the cells are not a complete grid of at least 2 by 2; make a map with 'nlosctl posterior'")
    cell = np.array([(ticks[-1] - ticks[0]) / max(ticks.size - 1, 1) for ticks in (across, along)])
    cell = np.where(cell > 0.0, cell, cell.max())
    corner = np.array([across[0], along[0]]) - 0.5 * cell
    order = np.lexsort((x, y))
    least = (hpd - probability)[order].reshape(along.size, across.size)
    parts = []
    for level in _LEVELS:
        rings = [corner + cell * ring for ring in cell_outlines(least < level - _ROUNDING)]
        parts.append(rings if metres else _on_earth(rings, columns, planes))
    named: Mapping[str, Sequence[Any]] = {} if snapshot is None else {"snapshot": [snapshot] * len(_LEVELS)}
    return Shapes(columns={**named, "probability": list(_LEVELS)}, feature="region", parts=parts, closed=True)


def _on_earth(rings: Sequence[FloatArray], columns: Columns, planes: Planes) -> list[FloatArray]:
    """Return rings in longitude and latitude, each outside with its holes on its side of the 180th meridian."""
    ((plane, _),) = planes({name: values[:1] for name, values in columns.items()}, 1)
    whole: list[FloatArray] = []
    for polygon in rings_by_polygon(rings):
        group = [_placed(plane, ring) for ring in polygon]
        if not any(crosses_antimeridian(ring) for ring in group):
            whole += group
            continue
        holes = [part[::-1] for ring in group[1:] for part in cut_ring(ring[::-1])]
        for outside in cut_ring(group[0]):
            side = np.sign(outside[:, 0].mean())
            whole += [outside, *(hole for hole in holes if np.sign(hole[:, 0].mean()) == side)]
    return whole


def _placed(plane: EarthPlane, ring: FloatArray) -> FloatArray:
    lat, lon = plane.to_earth(ring[:, 0], ring[:, 1])
    placed = np.stack([lon, lat], axis=1)
    placed[-1] = placed[0]
    return placed
