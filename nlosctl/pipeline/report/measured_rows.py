"""Rows of measurements as the page draws them: rays, circles and arcs, hyperbolas, rays and ellipses of triplets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import CircleReflector, PlaneReflector, Reflector, SphereReflector
from nlosctl.io.results.plotted_rows import differences_of, kinds_of_rows
from nlosctl.io.results.sampled_snapshots import SampledSnapshots
from nlosctl.models.traced_rays import points_at_range, ray_paths
from nlosctl.pipeline.report.numbers import decimals_of, rounded
from nlosctl.pipeline.report.plane_map import PlaneMap
from nlosctl.pipeline.report.range_arcs import range_arcs

__all__ = ["LOOKS", "MeasuredRows"]

LOOKS = ("direct", "reflected", "flagged", "unused")
"""The kinds of rows; the page has their indices."""

_MOST_CURVES, _EVERY = 1000, 16
"""Ranges by a circle have curves of so many rows, of one in so many of their points, since these are long."""


class MeasuredRows:
    """The rows of one file of measurements or flags, for the map of the page.

    Create it before the map is settled, which needs its sensors; `content` is for a map that is settled.
    """

    def __init__(self, sample: SampledSnapshots, plane: PlaneMap) -> None:
        self._sample, self._plane = sample, plane
        self.notes: list[str] = []
        flags = dict(sample.flags)
        if "ip" in flags:  # an indirect path counts as a flagged one
            flags["los"] = np.where(flags["ip"] == 1, 0, flags.get("los", np.full(flags["ip"].shape, 1)))
        kinds = kinds_of_rows(sample.columns, flags, sample.left_out)
        self._look = np.select([kinds == kind for kind in LOOKS], np.arange(len(LOOKS)))
        columns = sample.columns
        if sample.kind == "triplets":
            nodes = ("transmitter", "receiver")
            self._nodes = [
                plane.add_sensors(nodes, np.full(self._look.shape, number), self._positions(node))
                for number, node in enumerate(("tx", "rx"))
            ]
        else:
            self._sensor = plane.add_sensors(sample.sensor_names, columns["sensor"], self._positions("sensor"))
            if "reference" in columns:
                known = np.isfinite(self._positions("reference")).all(axis=1)
                plane.add_sensors(sample.sensor_names, columns["reference"][known], self._positions("reference")[known])

    def content(self, snapshot: IntArray) -> dict[str, Any]:
        """Return the rows as plain columns; ``snapshot`` (S,) is the index of each snapshot on the page."""
        draw: Callable[[], dict[str, Any]] = {
            "bearings": self._rays,
            "ranges": self._circles,
            "arrivals": self._hyperbolas,
            "triplets": self._triplets,
        }[self._sample.kind]
        rows = {"look": self._look.tolist(), "size": np.diff(self._sample.offsets).tolist()} | draw()
        return {"kind": self._sample.kind, "snapshot": snapshot.tolist(), **rows}

    def _positions(self, node: str) -> FloatArray:
        return np.stack([self._sample.columns[f"{node}_{axis}_m"] for axis in "xy"], axis=1)

    def _by_reflector(self, draw: Callable[[IntArray, Reflector | None], None]) -> None:
        """Call ``draw`` with the rows of each reflector, and (None) the direct ones."""
        reflector = self._sample.columns.get("reflector", np.full(self._look.shape, -1))
        for number in np.unique(reflector).tolist():
            draw(np.flatnonzero(reflector == number), self._sample.scene.reflectors[number] if number >= 0 else None)

    def _traced(self, origin_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Return the corners (N, 3, 2) of rays beyond the map; NaN for those by mirrors of space."""
        paths = np.full((*bearing_rad.shape, 3, 2), np.nan)

        def draw(rows: IntArray, mirror: Reflector | None) -> None:
            if isinstance(mirror, PlaneReflector | SphereReflector):
                self.notes.append(f"{rows.size} rows by {mirror.name!r}, a mirror in space, are not drawn")
                return
            corners = (self._plane.low_m, self._plane.high_m)
            paths[rows] = ray_paths(origin_m[rows], bearing_rad[rows], mirror, *corners)

        self._by_reflector(draw)
        return paths

    def _ends(self, paths: FloatArray, name: str) -> dict[str, Any]:
        """Return the last corners of rays as columns."""
        return {f"{name}_{axis}": self._plane.coordinates(paths[:, 2, k], k) for k, axis in enumerate("xy")}

    def _rays(self) -> dict[str, Any]:
        bearing = self._sample.columns["bearing_rad"]
        paths = self._traced(self._positions("sensor"), bearing)
        content = {
            "sensor": self._sensor.tolist(),
            "value": rounded(np.degrees(bearing), 2),
            **self._ends(paths, "end"),
        }
        reflected = (paths[:, 1] != paths[:, 0]).any(axis=1) & np.isfinite(paths[:, 1]).all(axis=1)
        if reflected.any():
            hit = np.where(reflected[:, None], paths[:, 1], np.nan)
            content |= {f"hit_{axis}": self._plane.coordinates(hit[:, k], k) for k, axis in enumerate("xy")}
        return content

    def _circles(self) -> dict[str, Any]:
        length = self._sample.columns["range_m"]
        arcs, curves = np.full((length.size, 4), np.nan), dict[str, list[Any]]()

        def draw(rows: IntArray, mirror: Reflector | None) -> None:
            if isinstance(mirror, PlaneReflector | SphereReflector | CircleReflector):
                arcs[rows] = 0.0
                drawn = 0
                if isinstance(mirror, CircleReflector):
                    own = {str(row): self._curve(row, mirror) for row in rows[:_MOST_CURVES].tolist()}
                    curves.update(own)
                    drawn = len(own)
                if drawn < rows.size:
                    self.notes.append(f"{rows.size - drawn} ranges by {mirror.name!r} are listed, not drawn")
            elif mirror is not None:
                arcs[rows] = range_arcs(self._positions("sensor")[rows], length[rows], mirror)

        self._by_reflector(draw)
        if self._sample.dimension == 3 or "sensor_z_m" in self._sample.columns:
            self.notes.append("ranges are drawn as horizontal")
        content = {"sensor": self._sensor.tolist(), "value": rounded(length, self._decimals(length))}
        if np.isfinite(arcs).any():
            content |= {f"image_{axis}": self._plane.coordinates(arcs[:, k], k) for k, axis in enumerate("xy")}
            content |= {"from": rounded(arcs[:, 2], 4), "to": rounded(arcs[:, 3], 4), "curves": curves}
        return content

    def _curve(self, row: int, mirror: CircleReflector) -> list[Any]:
        """Return the points of the range of a row by a circle as x, y, x, y, ..., None between parts of the curve."""
        sensor = self._positions("sensor")[row]
        points = points_at_range(sensor, float(self._sample.columns["range_m"][row]), mirror)[::_EVERY]
        return [
            part
            for pair in zip(*(self._plane.coordinates(points[:, k], k) for k in (0, 1)), strict=True)
            for part in pair
        ]

    def _decimals(self, length_m: FloatArray) -> int:
        return min(self._plane.decimals + 1, decimals_of(float(np.nanmedian(np.abs(length_m))), 7))

    def _hyperbolas(self) -> dict[str, Any]:
        frame = self._sample.scene.frame
        drawn = self._sample.dimension == 2 and not (frame is not None and frame.on_ellipsoid)
        if not drawn:
            self.notes.append("differences of arrivals in three dimensions are listed, not drawn")
        found = [differences_of(snapshot) for snapshot in self._sample.plot_snapshots()]
        sensor, reference = (
            self._plane.sensors_at(np.concatenate([getattr(each, part)[:, :2] for each in found]))
            for part in ("sensor_m", "reference_m")
        )
        difference = np.concatenate([each.difference_m for each in found])
        looks = [LOOKS.index(kind) for each in found for kind in each.kind]
        return {
            "look": looks,
            "size": [each.difference_m.size for each in found],
            "sensor": sensor.tolist(),
            "reference": reference.tolist(),
            "value": rounded(difference, self._decimals(difference) + 1),
            "drawn": drawn,
        }

    def _triplets(self) -> dict[str, Any]:
        columns, (tx, rx) = self._sample.columns, self._nodes
        length, drawn = columns["path_length_m"], self._sample.dimension == 2
        if not drawn:
            self.notes.append("of triplets in three dimensions the plan has the rays, not the ellipses")
        return {
            "sensor": tx.tolist(),
            "reference": rx.tolist(),
            "value": rounded(length, self._decimals(length)),
            "departing": rounded(np.degrees(columns["dod_rad"]), 2),
            "arriving": rounded(np.degrees(columns["doa_rad"]), 2),
            "ellipses": drawn,
        }
