"""Snapshots in space: plan and elevation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pytest

import nlosctl
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, SphereReflector
from nlosctl.errors import UsageError
from nlosctl.models.ranges.predictions import predict_space_ranges
from nlosctl.models.sections import path_lengths_by_sphere
from nlosctl.models.traced_rays import trace_in_space
from nlosctl.plotting.library import Axes, Circle, Ellipse, LineCollection
from nlosctl.plotting.views.two_views import seen_reflectors

SOURCE = (25.0, 10.0, 8.0)


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


def lines_of(axes: Axes, label: str) -> list[np.ndarray]:
    """Return the points of the long lines of the color of a label."""
    colors = {line.get_color() for line in axes.lines if str(line.get_label()).startswith(label)}
    return [line.get_xydata() for line in axes.lines if line.get_color() in colors and len(line.get_xdata()) > 50]


def passes(curve: np.ndarray, point: Sequence[float]) -> bool:
    """Whether a polyline passes a point."""
    away = np.linalg.norm(curve - np.asarray(point), axis=1)
    return bool(np.nanmin(away) < 2.0 * np.nanmedian(np.linalg.norm(np.diff(curve, axis=0), axis=1)))


def exact_ranges(scene: Scene, *reflectors: str) -> pa.Table:
    """Return noise-free ranges of one source, direct and by the reflectors of a scene."""
    sensors = np.array([[0.0, 0.0, 12.0], [50.0, -20.0, 3.0], [-20.0, 40.0, 15.0]])
    index = {"": -1, **{name: number for number, name in enumerate(scene.reflector_names)}}
    rows = []
    for number, sensor in enumerate(sensors):
        for name in ("", *reflectors):
            parts = (tuple(np.array([value]) for value in end) for end in (sensor, SOURCE))
            (length,) = predict_space_ranges(*parts, np.array([index[name]]), scene)
            row = {"sensor": f"a{number}", "range_m": length, "range_std_m": 0.1, "reflector": name or None}
            row |= {f"sensor_{axis}_m": value for axis, value in zip("xyz", sensor.tolist(), strict=True)}
            rows.append(row | {f"truth_{axis}_m": value for axis, value in zip("xyz", SOURCE, strict=True)})
    return pa.Table.from_pylist(rows)


def test_ranges_are_sections_through_the_target() -> None:
    """Direct ranges and those by planes and walls pass through the source in both views."""
    scene = Scene(
        reflectors=(
            PlaneReflector(name="floor", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
            PlaneReflector(name="roof", point=(0.0, 60.0, 20.0), normal=(0.0, 1.0, 1.0)),
            LineReflector(name="wall", point=(-40.0, 0.0), direction=(0.0, 1.0)),
        )
    )
    rows = exact_ranges(scene, "floor", "roof", "wall")
    plan, side = nlosctl.plot(rows, scene=scene, dimensions=3).figure.axes[:2]
    for axes, seen in ((plan, [0, 1]), (side, ["xyz".index(side.get_xlabel()[0]), 2])):
        for label, count in (("range, direct", 3), ("range, by a mirror", 9)):
            drawn = lines_of(axes, label)
            assert len(drawn) == count
            assert all(passes(curve, np.array(SOURCE)[seen]) for curve in drawn)
    radii = [np.linalg.norm(curve, axis=1) for curve in lines_of(plan, "range, direct")[:1]]
    np.testing.assert_allclose(radii, np.hypot(SOURCE[0], SOURCE[1]))


def test_ranges_by_a_sphere_are_contours_of_path_lengths() -> None:
    """The contour passes through the source in the plan; the path is that in the plane of centre, sensor and source."""
    dome = SphereReflector(name="dome", center=(10.0, 0.0, -60.0), radius=200.0)
    length = float(path_lengths_by_sphere(np.array([0.0, 0.0, 12.0]), dome, np.array([SOURCE]))[0])
    rows = exact_ranges(Scene()).slice(0, 2).set_column(1, "range_m", pa.array([length, 10.0]))
    rows = rows.set_column(rows.column_names.index("reflector"), "reflector", pa.array(["dome", None]))
    plan = nlosctl.plot(rows, scene=Scene(reflectors=(dome,)), dimensions=3).figure.axes[0]
    (contour,) = plan.collections
    (path,) = contour.get_paths()
    assert np.min(np.linalg.norm(path.vertices - np.array(SOURCE[:2]), axis=1)) < 1.0


def test_many_ranges_in_space_are_faint() -> None:
    """More than 50 ranges: one collection of lines in each view."""
    rows = nlosctl.simulate("box", trials=1)
    many = pa.concat_tables([rows] * 10)
    many = many.set_column(many.column_names.index("sensor"), "sensor", pa.array([f"s{k}" for k in range(len(many))]))
    for axes in nlosctl.plot(many, dimensions=3).figure.axes[:2]:
        (lines,) = [drawn for drawn in axes.collections if isinstance(drawn, LineCollection)]
        assert 0 < len(lines.get_segments()) <= len(many)
        assert "range, direct" in str(axes.get_legend_handles_labels()[1])


def test_azimuths_alone_are_rays_of_the_plan() -> None:
    """Rows without an elevation have the direction of their azimuth in the plan, and no line in the elevation."""
    rows = nlosctl.simulate("space-ring", trials=1)
    empty = pa.nulls(rows.num_rows, pa.float64())
    alone = rows.set_column(rows.column_names.index("elevation_rad"), "elevation_rad", empty)
    picture = nlosctl.plot(alone, dimensions=3)
    plan, side = picture.figure.axes[:2]
    rays = np.array([line.get_xydata() for line in plan.lines if len(line.get_xdata()) == 3])
    leg = rays[:, 2] - rays[:, 0]
    turn = np.arctan2(leg[:, 1], leg[:, 0]) - np.array(rows["bearing_rad"])
    np.testing.assert_allclose(np.sin(0.5 * turn), 0.0, atol=1e-12)
    assert not [line for line in side.lines if len(line.get_xdata()) == 3]
    assert picture.notes == (f"{rows.num_rows} rows without an elevation are half-planes: in the plan alone",)


def test_azimuths_alone_by_mirrors_follow_vertical_ones() -> None:
    """A vertical plane reflects in the plan, a floor does not; rows by a tilted plane are noted."""
    mirrors = (
        PlaneReflector(name="wall", point=(100.0, 0.0, 0.0), normal=(2.0, 0.0, 0.0)),
        PlaneReflector(name="floor", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
        PlaneReflector(name="roof", point=(0.0, 0.0, 50.0), normal=(0.0, 1.0, 1.0)),
    )
    names = [mirror.name for mirror in mirrors]
    rows = pa.table(
        {
            "sensor": names,
            **{f"sensor_{axis}_m": [value] * 3 for axis, value in zip("xyz", (0.0, 0.0, 5.0), strict=True)},
            "bearing_rad": [0.1] * 3,
            "bearing_std_rad": [0.01] * 3,
            "elevation_rad": pa.nulls(3, pa.float64()),
            "elevation_std_rad": [0.01] * 3,
            "reflector": names,
        }
    )
    picture = nlosctl.plot(rows, scene=Scene(reflectors=mirrors), dimensions=3)
    lines = [line for line in picture.figure.axes[0].lines if line.get_linestyle() != "None"]
    rays = [line.get_xydata() for line in lines if len(line.get_xdata()) == 3]
    assert [ray[1].tolist() for ray in rays] == [pytest.approx([100.0, 100.0 * np.tan(0.1)]), [0.0, 0.0]]
    assert picture.notes[1] == "1 rows without an elevation by tilted planes or spheres are not drawn"


def test_estimates_without_heights_are_noted() -> None:
    """A second file of estimates in the plane is left out of the views of space, and a note names it."""
    rows = nlosctl.simulate("space-ring", trials=1)
    picture = nlosctl.plot(
        rows, nlosctl.localize(rows).estimates, nlosctl.localize(rows, dimensions=2, method="ls").estimates
    )
    assert [note for note in picture.notes if note.endswith(": estimates without heights (z_m) are left out")]
    assert len(drawn_ellipses(picture.figure.axes[0])) == 1


def test_reflectors_of_space_among_places_on_earth_are_refused() -> None:
    """Places on the ellipsoid are drawn in the plane, which has no spheres: an error that names the reflector."""
    scene = Scene(reflectors=(SphereReflector(name="layer", center=(0.0, 0.0, -6.4e6), radius=6.7e6),))
    rows = pa.table(
        {
            "sensor": ["a"],
            "sensor_lat_deg": [48.0],
            "sensor_lon_deg": [11.0],
            "sensor_height_m": [500.0],
            "bearing_rad": [0.1],
            "bearing_std_rad": [0.01],
            "elevation_rad": [0.2],
            "elevation_std_rad": [0.01],
            "reflector": ["layer"],
        }
    )
    with pytest.raises(UsageError, match="reflector 'layer': places on earth in three dimensions"):
        nlosctl.plot(rows, scene=scene, dimensions=3)


def test_estimates_in_space_have_plan_and_elevation() -> None:
    """Each method has two panels with its fixes, and numpy's marginal ellipses in both."""
    rows = nlosctl.simulate("space-ring", trials=3)
    fixes = nlosctl.localize(rows, method=["ml", "stansfield"]).estimates
    panels = nlosctl.plot(fixes, view="estimates").figure.axes
    names = [f"{method} (3), {view}" for method in ("ml", "stansfield") for view in ("plan", "elevation")]
    assert [axes.get_title() for axes in panels] == names
    own = [row for row in fixes.to_pylist() if row["method"] == "ml"]
    for axes in panels[:2]:
        seen = axes.get_xlabel()[0] + axes.get_ylabel()[0]
        assert len(drawn_ellipses(axes)) == len(own) == 3
        for ellipse, row in zip(drawn_ellipses(axes), own, strict=True):
            assert_marginal_ellipse(ellipse, row, seen)


def test_echoes_in_space_are_circles_through_their_target() -> None:
    """Noise-free echoes of one target: every circle of both views passes through the estimate."""
    rows = exact_ranges(Scene()).drop_columns(["reflector"])
    flags = rows.append_column("target", pa.array([0] * rows.num_rows))
    flags = flags.append_column("los", pa.array([True] * rows.num_rows))
    fix = {"snapshot": 0, "method": "assignment", "target": 0, "alternative": 0, "status": "ok", "cost": 0.0}
    fix |= {"n_measurements": 3, "n_used": 3, **{f"{axis}_m": value for axis, value in zip("xyz", SOURCE, strict=True)}}
    fix |= {f"cov_{pair}_m2": float(pair[0] == pair[1]) for pair in ("xx", "xy", "yy", "xz", "yz", "zz")}
    panels = nlosctl.plot(flags, pa.Table.from_pylist([fix]), view="echoes", dimensions=3).figure.axes
    for axes in panels[:2]:
        seen = ["xyz".index(label[0]) for label in (axes.get_xlabel(), axes.get_ylabel())]
        circles = [patch for patch in axes.patches if isinstance(patch, Circle)]
        assert len(circles) == 3
        for circle in circles:
            away = np.linalg.norm(np.array(circle.center) - np.array(SOURCE)[seen])
            assert away == pytest.approx(circle.radius, rel=1e-9)


def test_triplets_in_space_have_three_points_on_rays_and_spheroid() -> None:
    """Noise-free direct triplet: all points of both views are the target; the outline touches no farther path."""
    ends, target = np.array([[-3.0, 0.0, 1.0], [5.0, 1.0, 2.5]]), np.array(SOURCE)
    legs = target - ends
    columns = {"path_length_m": [float(np.linalg.norm(legs, axis=1).sum())], "path_length_std_m": [0.1], "path": [0]}
    for side, node, end, leg in zip(("dod", "doa"), ("tx", "rx"), ends, legs, strict=True):
        columns |= {f"{node}_{axis}_m": [value] for axis, value in zip("xyz", end.tolist(), strict=True)}
        columns |= {f"{side}_rad": [np.arctan2(leg[1], leg[0])], f"{side}_std_rad": [0.01]}
        columns |= {f"{side}_elevation_rad": [np.arctan2(leg[2], np.hypot(leg[0], leg[1]))]}
        columns |= {f"{side}_elevation_std_rad": [0.01]}
    panels = nlosctl.plot(pa.table(columns), dimensions=3).figure.axes
    assert [axes.get_ylabel()[0] for axes in panels[:2]] == ["y", "z"]
    for axes in panels[:2]:
        seen = ["xyz".index(label[0]) for label in (axes.get_xlabel(), axes.get_ylabel())]
        for marker in ("o", "v", "<"):
            (point,) = [line for line in axes.lines if line.get_marker() == marker and len(line.get_xdata()) == 1]
            np.testing.assert_allclose(point.get_xydata()[0], target[seen], atol=1e-9)
        (outline,) = drawn_ellipses(axes)
        draw = np.random.default_rng(2).normal(size=(20000, 3))
        across = draw / np.linalg.norm(draw, axis=1)[:, None]
        excess = columns["path_length_m"][0] ** 2 - np.sum((ends[1] - ends[0]) ** 2)
        surface = (
            ends[0] + across * (0.5 * excess / (columns["path_length_m"][0] - across @ (ends[1] - ends[0])))[:, None]
        )
        turn = np.radians(outline.angle)
        frame = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        local = (
            (surface[:, seen] - np.array(outline.center)) @ frame.T / (0.5 * np.array([outline.width, outline.height]))
        )
        assert 0.99 < np.linalg.norm(local, axis=1).max() <= 1.0 + 1e-9
