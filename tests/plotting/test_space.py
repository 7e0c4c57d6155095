"""Snapshots in space: plan and elevation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pytest

import nlosctl
from nlosctl.contract.scene import LineReflector, PlaneReflector, SphereReflector
from nlosctl.models.traced_rays import trace_in_space
from nlosctl.plotting.library import Axes, Circle, Ellipse
from nlosctl.plotting.views.two_views import seen_reflectors


def drawn_ellipses(axes: Axes) -> list[Ellipse]:
    """Return the ellipses of a panel, without circles."""
    return [patch for patch in axes.patches if isinstance(patch, Ellipse) and not isinstance(patch, Circle)]


def assert_marginal_ellipse(ellipse: Ellipse, row: dict[str, float], seen: Sequence[str]) -> None:
    """Compare the axes of an ellipse with the eigenvalues of the covariance of two coordinates, times chi-square."""
    pairs = [["".join(sorted(first + second)) for second in seen] for first in seen]
    covariance = np.array([[row[f"cov_{pair}_m2"] for pair in line] for line in pairs])
    half = np.sqrt(-2.0 * np.log(0.05) * np.linalg.eigvalsh(covariance))
    np.testing.assert_allclose([ellipse.height / 2, ellipse.width / 2], half, rtol=1e-9)
    np.testing.assert_allclose(ellipse.center, [row[f"{axis}_m"] for axis in seen], rtol=1e-12)


def test_plan_and_elevation_have_the_marginal_ellipses() -> None:
    """Each view has one ray per row and the estimate's ellipse by numpy's eigenvalues, within its limits."""
    rows = nlosctl.simulate("street", trials=1)
    fixes = nlosctl.localize(rows, method="ml").estimates
    row = fixes.to_pylist()[0]
    panels = nlosctl.plot(rows, fixes).figure.axes
    assert [axes.get_ylabel()[0] for axes in panels[:2]] == ["y", "z"]
    for axes, seen in zip(panels, ("xy", "xz") * 2, strict=False):
        assert axes.get_xlabel()[0] == "x"
        rays = [line for line in axes.lines if len(line.get_xdata()) == 3]
        assert len(rays) == rows.num_rows
        (ellipse,) = drawn_ellipses(axes)
        assert_marginal_ellipse(ellipse, row, seen)
        assert axes.get_xlim()[0] <= ellipse.center[0] <= axes.get_xlim()[1]
        assert axes.get_ylim()[0] <= ellipse.center[1] <= axes.get_ylim()[1]


def test_rays_in_space_have_both_angles() -> None:
    """A drawn ray leaves its sensor, at its height, with the slope of its azimuth and of its elevation."""
    rows = nlosctl.simulate("space-ring", trials=1)
    plan, side = nlosctl.plot(rows).figure.axes[:2]
    across = side.get_xlabel()[0]
    columns = {name: np.array(rows[name]) for name in ("bearing_rad", "elevation_rad", "sensor_z_m")}
    step = {"x": np.cos(columns["bearing_rad"]), "y": np.sin(columns["bearing_rad"])}
    step["z"] = np.tan(columns["elevation_rad"])
    for axes, (right, up) in ((plan, "xy"), (side, across + "z")):
        paths = np.array([line.get_xydata() for line in axes.lines if len(line.get_xdata()) == 3])
        leg = paths[:, 2] - paths[:, 0]
        np.testing.assert_allclose(leg[:, 0] * step[up], leg[:, 1] * step[right], atol=1e-9 * np.abs(leg).max())
    np.testing.assert_allclose(paths[:, 0, 1], columns["sensor_z_m"], atol=1e-12)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 2.0), (1.0, -2.0, 0.5)])
def test_rays_by_a_plane_come_from_the_image_of_the_sensor(normal: tuple[float, float, float]) -> None:
    """The ray behind a plane mirror is the straight line from the mirror image of its sensor."""
    unit = np.array(normal) / np.linalg.norm(normal)
    sensor, point = np.array([1.0, 2.0, 3.0]), np.array([4.0, -1.0, 9.0])
    image = sensor - 2.0 * ((sensor - point) @ unit) * unit
    along = point + np.array([0.3, 0.2, -0.1]) - sensor
    along = along / np.linalg.norm(along)
    mirror = PlaneReflector(name="m", point=(4.0, -1.0, 9.0), normal=normal)
    hit, onward = trace_in_space(sensor, along, mirror)
    assert abs((hit - point) @ unit) < 1e-12
    np.testing.assert_allclose(np.cross(hit - image, onward), 0.0, atol=1e-12)


def test_rays_by_a_sphere_keep_their_angle_to_its_normal() -> None:
    """A ray meets the sphere on its surface, and its angle to the normal is the same on both sides."""
    center, along = np.array([1.0, 0.0, -5.0]), np.array([0.6, 0.0, 0.8])
    hit, onward = trace_in_space(
        np.array([2.0, 1.0, 0.0]), along, SphereReflector(name="s", center=(1.0, 0.0, -5.0), radius=9.0)
    )
    assert np.linalg.norm(hit - center) == pytest.approx(9.0, rel=1e-12)
    assert (hit - center) @ onward == pytest.approx(-((hit - center) @ along), rel=1e-12)


def test_mirrors_are_lines_in_the_views_they_are_across() -> None:
    """A floor is a line in both elevations, a wall along x in the plan and over y; neither is in the third view."""
    floor = PlaneReflector(name="floor", point=(0.0, 0.0, 1.0), normal=(0.0, 0.0, 1.0))
    wall = LineReflector(name="wall", point=(3.0, 7.0), direction=(1.0, 0.0))
    shown = {seen: [mirror.name for mirror in seen_reflectors((floor, wall), seen)] for seen in ("xy", "xz", "yz")}
    assert shown == {"xy": ["wall"], "xz": ["floor"], "yz": ["floor", "wall"]}


def test_flagged_rows_have_their_own_look_in_space() -> None:
    """A row with los false is a flagged ray in both views."""
    rows = nlosctl.simulate("space-ring", trials=1)
    los = pa.array([False] + [True] * (rows.num_rows - 1))
    flagged = rows.append_column("los", los)
    for axes in nlosctl.plot(flagged).figure.axes[:2]:
        assert [line.get_label() for line in axes.lines].count("bearing, flagged (los false)") == 1
