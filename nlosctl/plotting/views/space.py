"""One snapshot over its scene, in the plane, or in space as plan and elevation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Scene
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.io.results.plotted_rows import row_kinds, row_positions
from nlosctl.plotting.figures import figure_style, new_figure
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.many_rows import MANY_ROWS, draw_tracks
from nlosctl.plotting.views.measured_rows import first_measurements, sensor_positions
from nlosctl.plotting.views.scene import draw_in_plane
from nlosctl.plotting.views.snapshot_rows import Columns, draw_estimates_of_snapshot, draw_truth, estimate_rows_of
from nlosctl.plotting.views.space_rows import draw_rays, draw_sections, trace_rays
from nlosctl.plotting.views.two_views import (
    VIEWS,
    across,
    coordinates,
    draw_plan_and_elevation,
    scene_positions,
    seen_reflectors,
)

__all__ = ["draw_scene_view"]


@figure_style()
def draw_scene_view(request: PlotRequest) -> Picture:
    """Draw one snapshot, measurements, estimates, or both: in the plane, or in space by plan and elevation.

    Places on the ellipsoid are drawn in the plane.
    """
    measured, files = first_measurements(request), request.of("estimates")
    snapshot, estimates = estimate_rows_of(files, request.snapshot if measured is None else measured.id)
    scene = request.files[0].scene if measured is None else measured.scene
    curved = scene.frame is not None and scene.frame.on_ellipsoid
    heights = [prefix_rows for prefix_rows in estimates if "z_m" in prefix_rows[1]]
    in_space = bool(heights) if measured is None else "sensor_z_m" in measured.columns
    in_space &= bool(heights) or (measured is not None and measured.dimension == 3)
    if curved or not in_space or request.read.dimensions == 2:
        return draw_in_plane(request, measured, snapshot, estimates)
    flat = [file.name for file, (_, columns) in zip(files, estimates, strict=True) if "z_m" not in columns]
    notes = [f"{', '.join(flat)}: estimates without heights (z_m) are left out"] if flat else []
    shown = _Snapshot(scene, measured, heights, request.target_z_m)
    return _draw_in_space(request, shown, f"Snapshot {snapshot}", notes)


@dataclass(frozen=True)
class _Snapshot:
    """What the views show."""

    scene: Scene
    measured: PlotSnapshot | None
    estimates: Sequence[tuple[str, Columns]]
    target_z_m: float | None

    @property
    def truth(self) -> Columns:
        """The columns that may have the truth."""
        return self.estimates[0][1] if self.measured is None else self.measured.file_columns

    def draw_known(self, axes: Axes, extent: Extent, seen: str) -> list[str]:
        """Draw the truth and the estimates in a view; return notes."""
        draw_truth(axes, self.truth, extent, seen)
        return draw_estimates_of_snapshot(axes, self.estimates, extent, seen)

    def draw_sensors(self, axes: Axes, extent: Extent, seen: str) -> None:
        """Draw the sensors in a view."""
        if self.measured is not None and len(self.measured.sensor) > MANY_ROWS:
            position = row_positions(self.measured, "sensor", 3)[:, coordinates(seen)]
            draw_tracks(axes, self.measured.sensor, position)
        else:
            measured = self.measured
            names, sensors = scene_positions(self.scene) if measured is None else sensor_positions(measured, 3)
            position = sensors[:, coordinates(seen)]
            draw_sensors(axes, names, position)
        extent.include(position)

    def depth_m(self, seen: str) -> float | None:
        """Return the coordinate across a view at which it shows sections: that of the first estimate, or of the truth.

        In the plan it is the height of the targets, if given. None without any.
        """
        axis = across(seen)
        if axis == "z" and self.target_z_m is not None:
            return self.target_z_m
        known = [columns[f"{axis}_m"] for _, columns in self.estimates]
        known += [self.truth[f"truth_{axis}_m"]] if f"truth_{axis}_m" in self.truth else []
        values = np.concatenate([part.astype(np.float64) for part in known]) if known else np.empty(0)
        return next((float(value) for value in values if np.isfinite(value)), None)


def _draw_in_space(request: PlotRequest, shown: _Snapshot, title: str, notes: list[str]) -> Picture:
    measured = shown.measured
    kinds = np.array([] if measured is None else row_kinds(measured), dtype=object)
    rays = np.empty((0, 3, 3))
    if measured is not None and "bearing_rad" in measured.columns:
        rays, remarks = _rays_of(shown, measured)
        notes = notes + remarks

    def draw(axes: Axes, seen: str) -> tuple[Extent, Extent, list[str]]:
        focus, whole = Extent(), Extent()
        drawn = shown.draw_known(axes, focus, seen)
        whole.include_extent(focus)
        draw_reflectors(axes, seen_reflectors(shown.scene.reflectors, seen))
        shown.draw_sensors(axes, whole, seen)
        whole.include(rays[..., coordinates(seen)].reshape(-1, 2))
        if rays.size:
            draw_rays(axes, rays, kinds, seen)
        elif measured is not None:
            drawn += draw_sections(axes, measured, kinds, seen, shown.depth_m(seen), whole)
        return whole, focus if shown.estimates else Extent(), notes + drawn

    return draw_plan_and_elevation(request, draw, title, shown.scene.frame)


def _rays_of(shown: _Snapshot, measured: PlotSnapshot) -> tuple[FloatArray, list[str]]:
    """Return the traced bearings (K, 3, 3) towards the estimates and the truth, and notes."""
    _, (scratch,) = new_figure()
    known = {seen: Extent() for seen in VIEWS}
    for seen, extent in known.items():
        shown.draw_known(scratch, extent, seen)
    if known["xz"].is_known:
        (x, z), (y, _) = (0.5 * (known[seen].low + known[seen].high) for seen in ("xz", "yz"))
        return trace_rays(measured, known["xy"], np.array([x, y, z]))
    plan = Extent()
    plan.include(row_positions(measured))
    return trace_rays(measured, plan, None)
