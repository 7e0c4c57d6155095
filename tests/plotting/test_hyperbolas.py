"""Snapshots of arrivals: a hyperbola per row, in the plane, in space and on earth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyproj

import nlosctl
from nlosctl.plotting.library import Axes, LineCollection

SOURCE = np.array([120.0, -60.0, 80.0])
SENSORS = np.array(
    [[500.0, 0.0, 0.0], [0.0, 500.0, 90.0], [-500.0, 0.0, 0.0], [0.0, -500.0, 90.0], [300.0, 300.0, 40.0]]
)


def arrivals(dimension: int = 2, **columns: Any) -> pa.Table:
    """Return noise-free arrivals of one source; further columns replace or add."""
    rows = {"sensor": [f"s{number}" for number in range(len(SENSORS))], "arrival_std_m": [1.0] * len(SENSORS)}
    rows |= {f"sensor_{axis}_m": SENSORS[:, number] for number, axis in enumerate("xyz"[:dimension])}
    distance = np.linalg.norm(SENSORS[:, :dimension] - SOURCE[:dimension], axis=1)
    return pa.table({**rows, "arrival_m": 1e6 + distance, **columns})


def differences(*pairs: tuple[int, int]) -> pa.Table:
    """Return the differences of sensors to references, without rows of the references."""
    own, reference = (SENSORS[[pair[side] for pair in pairs], :2] for side in (0, 1))
    value = np.linalg.norm(own - SOURCE[:2], axis=1) - np.linalg.norm(reference - SOURCE[:2], axis=1)
    names = [[f"s{pair[side]}" for pair in pairs] for side in (0, 1)]
    columns = {"sensor": names[0], "reference": names[1], "tdoa_m": value, "arrival_std_m": [1.0] * len(pairs)}
    for number, axis in enumerate("xy"):
        columns |= {f"sensor_{axis}_m": own[:, number], f"reference_{axis}_m": reference[:, number]}
    return pa.table(columns)


def curves(axes: Axes, label: str = "hyperbola") -> list[np.ndarray]:
    """Return the points of the curves whose kind begins with the label, the further curves of the kind too."""
    lines = [line for line in axes.lines if len(line.get_xdata()) > 100]
    colors = {line.get_color() for line in lines if str(line.get_label()).startswith(label)}
    return [line.get_xydata() for line in lines if line.get_color() in colors]


def gap(curve: np.ndarray, point: np.ndarray) -> float:
    """Return the distance of a point from a polyline."""
    leg, away = np.diff(curve, axis=0), point - curve[:-1]
    share = np.clip(np.sum(away * leg, axis=1) / np.sum(leg * leg, axis=1), 0.0, 1.0)
    return float(np.min(np.linalg.norm(away - share[:, None] * leg, axis=1)))


def references(axes: Axes) -> np.ndarray:
    """Return the marked references."""
    (marks,) = [line for line in axes.lines if line.get_label() == "reference of differences"]
    return np.asarray(marks.get_xydata())


def test_each_row_is_a_hyperbola_through_the_source() -> None:
    """Noise-free rows against the earliest of equal std: all but the reference, with a band of +-1 std each."""
    axes = nlosctl.plot(arrivals()).figure.axes[0]
    drawn = curves(axes)
    assert len(drawn) == len(SENSORS) - 1
    assert max(gap(curve, SOURCE[:2]) for curve in drawn) < 0.01
    nearest = np.argmin(np.linalg.norm(SENSORS[:, :2] - SOURCE[:2], axis=1))
    np.testing.assert_array_equal(references(axes), SENSORS[[nearest], :2])
    assert len([patch for patch in axes.patches if type(patch).__name__ == "Polygon"]) == len(drawn)


def test_bands_are_hyperbolas_one_std_apart() -> None:
    """Their edges have the difference plus and minus the std of the difference of two arrivals."""
    std = [2.0, 1.0, 2.0, 2.0, 2.0]
    axes = nlosctl.plot(arrivals(arrival_std_m=std)).figure.axes[0]
    np.testing.assert_array_equal(references(axes), SENSORS[[1], :2])
    patch = next(patch for patch in axes.patches if type(patch).__name__ == "Polygon")
    corners = patch.get_xy()[:-1]
    low, high = np.split(corners, 2)
    distance = [np.linalg.norm(edge[:, None] - SENSORS[:2, :2], axis=2) for edge in (low, high)]
    value = float(np.diff(np.linalg.norm(SENSORS[:2, :2] - SOURCE[:2], axis=1))[0])
    for edge, sign in zip(distance, (-1.0, 1.0), strict=True):
        np.testing.assert_allclose(edge[:, 0] - edge[:, 1], -value + sign * np.sqrt(5.0), atol=1e-6)


def test_flagged_arrivals_are_no_reference() -> None:
    """The earliest row is flagged: another is the reference, and the row is dotted and without a band."""
    nearest = int(np.argmin(np.linalg.norm(SENSORS[:, :2] - SOURCE[:2], axis=1)))
    los = [number != nearest for number in range(len(SENSORS))]
    axes = nlosctl.plot(arrivals(los=los)).figure.axes[0]
    assert (references(axes) != SENSORS[nearest, :2]).any()
    assert len(curves(axes, "hyperbola, flagged")) == 1
    assert len(curves(axes)) == len(SENSORS) - 1
    assert len([patch for patch in axes.patches if type(patch).__name__ == "Polygon"]) == len(SENSORS) - 2


def test_differences_have_the_reference_of_the_file() -> None:
    """Its sensor is drawn with its name though it has no row."""
    axes = nlosctl.plot(differences((1, 0), (2, 0), (3, 0))).figure.axes[0]
    np.testing.assert_array_equal(references(axes), SENSORS[[0], :2])
    assert max(gap(curve, SOURCE[:2]) for curve in curves(axes)) < 0.01


def test_independent_differences_have_bands_of_their_own_std() -> None:
    """With several references the band of a row is that of its std, not of the difference of two arrivals."""
    axes = nlosctl.plot(differences((1, 0), (2, 1), (3, 2))).figure.axes[0]
    assert {tuple(place) for place in references(axes)} == {tuple(place) for place in SENSORS[:3, :2]}
    assert max(gap(curve, SOURCE[:2]) for curve in curves(axes)) < 0.01
    patches = [patch.get_xy()[:-1] for patch in axes.patches if type(patch).__name__ == "Polygon"]
    assert len(patches) == 3
    value = float(np.diff(np.linalg.norm(SENSORS[:2, :2] - SOURCE[:2], axis=1))[0])
    for edge, sign in zip(np.split(patches[0], 2), (-1.0, 1.0), strict=True):
        distance = np.linalg.norm(edge[:, None] - SENSORS[:2, :2], axis=2)
        np.testing.assert_allclose(distance[:, 1] - distance[:, 0], value + sign, atol=1e-6)
    assert {"s0", "s1", "s2", "s3"} <= {text.get_text() for text in axes.texts}


def test_impossible_differences_are_noted() -> None:
    """A difference longer than the baseline has no hyperbola, and its band none either."""
    late = np.linalg.norm(SENSORS[:, :2] - SOURCE[:2], axis=1)
    late[2] += 2000.0
    picture = nlosctl.plot(arrivals(arrival_m=late))
    assert picture.notes == ("1 of 4 differences are longer than the distance of their sensors: no hyperbola",)
    assert len(curves(picture.figure.axes[0])) == 3


def test_many_arrivals_are_faint_lines() -> None:
    """More than 50 rows: one collection of lines without bands."""
    rows = nlosctl.simulate("arrivals", trials=1, sensors=60)
    axes = nlosctl.plot(rows).figure.axes[0]
    (lines,) = [drawn for drawn in axes.collections if isinstance(drawn, LineCollection)]
    assert len(lines.get_segments()) == 59
    assert not [patch for patch in axes.patches if type(patch).__name__ == "Polygon"]


def test_views_of_space_have_the_sections_through_the_estimate() -> None:
    """Plan and elevation: the hyperboloids of noise-free rows cross at the estimate in both."""
    rows = arrivals(3)
    fixes = nlosctl.localize(rows, method="ml", dimensions=3).estimates
    picture = nlosctl.plot(rows, fixes, dimensions=3)
    plan, side = picture.figure.axes[:2]
    for axes, seen in ((plan, [0, 1]), (side, ["xyz".index(side.get_xlabel()[0]), 2])):
        assert len(curves(axes)) == len(SENSORS) - 1
        assert max(gap(curve, SOURCE[seen]) for curve in curves(axes)) < 0.01
    assert picture.notes[0] == "the hyperbolas are sections at z = 80 m"
    alone = nlosctl.plot(rows, dimensions=3)
    assert "no hyperbolas in the view of x and y" in alone.notes[0]
    assert not curves(alone.figure.axes[0])
    at_height = nlosctl.plot(rows, dimensions=3, target_z_m=80.0).figure.axes[0]
    assert max(gap(curve, SOURCE[:2]) for curve in curves(at_height)) < 0.01


def test_hyperbolas_on_earth_cross_at_the_place(tmp_path: Path) -> None:
    """Arrivals of straight ways between places 60 km apart, by pyproj: in the horizontal plane of the estimate."""
    to_space = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    latitude, longitude = [48.0, 48.05, 48.5, 48.2, 48.26], [11.0, 11.8, 11.5, 11.25, 11.38]
    height = [520.0, 640.0, 490.0, 560.0, 10360.0]
    place = np.array(to_space.transform(longitude, latitude, height)).T
    names = ("sensor_lat_deg", "sensor_lon_deg", "sensor_height_m")
    rows = pa.table(
        {
            "sensor": list("abcd"),
            **dict(zip(names, (latitude[:4], longitude[:4], height[:4]), strict=True)),
            "arrival_m": np.linalg.norm(place[:4] - place[4], axis=1),
            "arrival_std_m": [1.0] * 4,
        }
    )
    x, y = pyproj.Transformer.from_crs(
        4326, "+proj=aeqd +lat_0=48.0 +lon_0=11.0 +ellps=WGS84", always_xy=True
    ).transform(longitude[4], latitude[4])
    fix = {"snapshot": 0, "method": "ml", "target": 0, "alternative": 0, "x_m": x, "y_m": y, "z_m": height[4]}
    fix |= {f"cov_{pair}_m2": float(pair[0] == pair[1]) for pair in ("xx", "xy", "yy", "xz", "yz", "zz")}
    fix |= {"n_measurements": 4, "n_used": 4, "cost": 0.0, "status": "ok", "frame": "48.0 11.0 ellipsoid"}
    axes = nlosctl.plot(rows, pa.Table.from_pylist([fix]), dimensions=3).figure.axes[0]
    assert len(curves(axes)) == 3
    assert max(gap(curve, np.array([x, y])) for curve in curves(axes)) < 0.3
