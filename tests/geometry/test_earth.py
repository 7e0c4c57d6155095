"""Planes on the earth, compared with pyproj's geodesics and transformations."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pyproj.database
import pytest

from nlosctl.errors import UsageError
from nlosctl.geometry.earth import EarthPlane, flat_errors

GEOD = pyproj.Geod(ellps="WGS84")
ZURICH = {"origin_lat_deg": 47.37, "origin_lon_deg": 8.54}
PLANES = {
    "tangent": ZURICH,
    "turned": {**ZURICH, "rotation_deg": 30.0},
    "utm": {"crs": "EPSG:32632"},
    "swiss": {"crs": "EPSG:2056"},
    "south": {"origin_lat_deg": -33.9, "origin_lon_deg": 151.2},
}


def plane_of(name: str) -> EarthPlane:
    """Return a plane by its name in `PLANES`."""
    return EarthPlane(**PLANES[name])


def test_the_tangent_plane_is_azimuthal_equidistant() -> None:
    """Lengths and azimuths from the origin are exact."""
    for azimuth, length in ((0.0, 1e3), (37.0, 5e4), (90.0, 3e5), (205.0, 1e6)):
        lon, lat, _ = GEOD.fwd(ZURICH["origin_lon_deg"], ZURICH["origin_lat_deg"], azimuth, length)
        x, y = plane_of("tangent").to_plane(np.array([lat]), np.array([lon]))
        assert x[0] == pytest.approx(length * math.sin(math.radians(azimuth)), abs=1e-3)
        assert y[0] == pytest.approx(length * math.cos(math.radians(azimuth)), abs=1e-3)


@pytest.mark.parametrize("name", PLANES)
def test_coordinates_round_trip(name: str) -> None:
    """To the plane and back returns the same coordinates; NaN stays NaN."""
    plane = plane_of(name)
    lat0, lon0 = (-33.9, 151.2) if name == "south" else (47.37, 8.54)
    lat = np.array([lat0 + 0.2, lat0 - 0.1, np.nan])
    lon = np.array([lon0 - 0.3, lon0 + 0.2, lon0])
    back = plane.to_earth(*plane.to_plane(lat, lon))
    np.testing.assert_allclose(back[0], lat, atol=1e-9)
    np.testing.assert_allclose(back[1], np.where(np.isnan(lat), np.nan, lon), atol=1e-9)


@pytest.mark.parametrize("name", PLANES)
@pytest.mark.parametrize(("east", "north"), [(0.0, 0.0), (0.6, 0.3), (-0.8, -0.4)])
def test_north_is_the_direction_of_a_step_north(name: str, east: float, north: float) -> None:
    """True north is the direction of a small geodesic step north, with meridian convergence and rotation."""
    plane = plane_of(name)
    lat, lon = (-33.9, 151.2) if name == "south" else (47.37, 8.54)
    lat, lon = lat + north, lon + east
    step_lon, step_lat, _ = GEOD.fwd(lon, lat, 0.0, 10.0)
    x, y = plane.to_plane(np.array([lat, step_lat]), np.array([lon, step_lon]))
    found = plane.north_rad(x[:1], y[:1])[0]
    assert found == pytest.approx(math.atan2(y[1] - y[0], x[1] - x[0]), abs=2e-6)


def worst_azimuth_error_deg(crs: str) -> float:
    """Return the largest error of north over the area of a CRS, by geodesic steps of 10 m; 0 if the CRS is refused."""
    try:
        plane = EarthPlane(crs=crs)
    except UsageError:
        return 0.0
    area = pyproj.CRS(crs).area_of_use
    if area is None:
        return 0.0
    east = area.east + (360.0 if area.east < area.west else 0.0)
    errors = []
    for share in (0.2, 0.5, 0.8):
        lat, lon = area.south + share * (area.north - area.south), area.west + share * (east - area.west)
        step_lon, step_lat, _ = GEOD.fwd(lon, lat, 0.0, 10.0)
        x, y = plane.to_plane(np.array([lat, step_lat]), (np.array([lon, step_lon]) + 180.0) % 360.0 - 180.0)
        direction = math.atan2(y[1] - y[0], x[1] - x[0])
        errors.append(abs(math.degrees(math.remainder(direction - plane.north_rad(x[:1], y[:1])[0], 2.0 * math.pi))))
    return max(errors)


MERIDIANS = {
    "Paris": "EPSG:27572",
    "Bern": "EPSG:21780",
    "Oslo": "EPSG:27391",
    "Ferro": "EPSG:31288",
    "Bogota": "EPSG:21892",
}


@pytest.mark.parametrize("crs", [*MERIDIANS.values(), "EPSG:3031", "EPSG:32661", "EPSG:3035", "EPSG:6933", "EPSG:2154"])
def test_north_of_a_crs_with_any_prime_meridian(crs: str) -> None:
    """Azimuths agree with geodesics to the rotation between datums, a few thousandths of a degree."""
    EarthPlane(crs=crs)
    assert worst_azimuth_error_deg(crs) < 0.004


@pytest.mark.parametrize(
    ("crs", "says"),
    [
        ("EPSG:2048", "axes Y \\(west\\) and X \\(south\\)"),
        ("EPSG:5513", "axes X \\(south\\) and Y \\(west\\)"),
        ("EPSG:2218", "no known transformation"),
        ("+proj=tmerc +lon_0=9 +axis=wsu +datum=WGS84 +units=m", "axes"),
        ("IAU_2015:30110", "no known transformation"),
    ],
)
def test_a_crs_without_east_and_north_is_refused(crs: str, says: str) -> None:
    """Southings and westings, and planes of no known relation to the earth, are errors and not turned bearings."""
    with pytest.raises(UsageError, match=says):
        EarthPlane(crs=crs)


def test_one_datum_operation_serves_all_points() -> None:
    """Points outside the area of the best operation are converted by it too: there and back is exact everywhere."""
    plane = EarthPlane(crs="EPSG:27700")
    lat, lon = plane.to_earth(np.array([0.0, 305055.0]), np.array([0.0, 610582.0]))
    np.testing.assert_allclose(plane.to_plane(lat, lon), [[0.0, 305055.0], [0.0, 610582.0]], atol=0.01)


@pytest.mark.parametrize("code", ["EPSG:3058", "EPSG:3303", "EPSG:8433", "ESRI:102159"])
def test_a_datum_that_is_turned_turns_north(code: str) -> None:
    """Datum operations with rotations turn directions by .004 to .025 degrees: north follows them."""
    assert worst_azimuth_error_deg(code) < 1e-4


@pytest.mark.slow
def test_north_of_every_projected_crs() -> None:
    """Each projected CRS that pyproj knows is refused, or its azimuths agree with geodesics."""
    infos = pyproj.database.query_crs_info(pj_types=[pyproj.enums.PJType.PROJECTED_CRS], allow_deprecated=True)
    codes = [f"{info.auth_name}:{info.code}" for info in infos]
    wrong = {code: error for code in codes if (error := worst_azimuth_error_deg(code)) > 0.004}
    assert len(codes) > 5000
    assert not wrong


def test_the_convergence_of_utm_is_that_of_the_textbook() -> None:
    """Grid north is east of true north by about the longitude difference times the sine of the latitude."""
    plane = plane_of("utm")
    x, y = plane.to_plane(np.array([60.0]), np.array([11.0]))
    gamma = math.atan(math.tan(math.radians(2.0)) * math.sin(math.radians(60.0)))
    assert plane.north_rad(x, y)[0] - math.pi / 2 == pytest.approx(gamma, abs=1e-5)


def test_plane_errors_agree_with_geodesics() -> None:
    """Errors vanish on lines from the origin; far away directions rotate, and UTM's scale shortens lengths."""
    far = np.array([2e5]), np.array([1e5])
    turned, stretched = flat_errors(plane_of("tangent"), np.zeros(1), np.zeros(1), *far)
    assert abs(turned[0]) < 1e-7
    assert abs(stretched[0]) < 1e-3
    turned, stretched = flat_errors(plane_of("tangent"), *far, far[0] + 1e5, far[1] - 1e5)
    assert 1e-5 < abs(turned[0]) < 1e-2
    assert 1.0 < abs(stretched[0]) < 1e3
    utm = flat_errors(plane_of("utm"), np.array([5e5]), np.array([5.2e6]), np.array([5e5]), np.array([5.21e6]))
    assert utm[1][0] == pytest.approx(-4e-4 * 1e4, rel=1e-2)
    assert np.isnan(flat_errors(plane_of("utm"), np.array([np.nan]), *([np.zeros(1)] * 3))[0]).all()


@pytest.mark.parametrize("name", PLANES)
def test_the_error_of_a_direction_is_plane_minus_earth(name: str) -> None:
    """The sign is that of the line's direction minus the geodesic's, in every quadrant."""
    plane = plane_of(name)
    lat, lon = (-33.9, 151.2) if name == "south" else (47.37, 8.54)
    for azimuth in (10.0, 100.0, 190.0, 280.0):
        to_lon, to_lat, _ = GEOD.fwd(lon + 2.0, lat + 1.0, azimuth, 1e5)
        x, y = plane.to_plane(np.array([lat + 1.0, to_lat]), np.array([lon + 2.0, to_lon]))
        turned, stretched = flat_errors(plane, x[:1], y[:1], x[1:], y[1:])
        along = plane.north_rad(x[:1], y[:1])[0] - math.radians(azimuth)
        expected = math.remainder(math.atan2(y[1] - y[0], x[1] - x[0]) - along, 2.0 * math.pi)
        assert turned[0] == pytest.approx(expected, abs=1e-9)
        assert abs(expected) > 1e-6
        assert stretched[0] == pytest.approx(math.hypot(x[1] - x[0], y[1] - y[0]) - 1e5, abs=1e-3)


def test_half_known_coordinates_give_nan() -> None:
    """With x or y unknown, latitude, longitude, north and line errors are NaN; other rows keep theirs."""
    plane, nan = plane_of("tangent"), np.nan
    x, y = np.array([1e3, nan, 1e3]), np.array([nan, 1e3, 1e3])
    for found in (*plane.to_earth(x, y), plane.north_rad(x, y), *flat_errors(plane, x, y, x + 9.0, y + 9.0)):
        assert np.isnan(found).tolist() == [True, True, False]
    assert np.isnan(plane.north_rad(x[:2], y[:2])).all()


@pytest.mark.parametrize("name", PLANES)
def test_coordinates_do_not_depend_on_the_block(name: str) -> None:
    """Each point, known or unknown, has the same north and errors in an array as alone."""
    plane = plane_of(name)
    lat0, lon0 = (-33.9, 151.2) if name == "south" else (47.37, 8.54)
    lat, lon = np.array([lat0, np.nan, lat0 + 0.5, lat0 - 0.5]), np.array([lon0, lon0, lon0 + 0.9, lon0 - 0.7])
    x, y = plane.to_plane(lat, lon)
    together = np.array([*plane.to_earth(x, y), plane.north_rad(x, y), *flat_errors(plane, x, y, x + 3e5, y - 2e5)])
    for row in range(4):
        here = slice(row, row + 1)
        alone = plane.to_plane(lat[here], lon[here])
        ends = (*alone, alone[0] + 3e5, alone[1] - 2e5)
        found = [*plane.to_earth(*alone), plane.north_rad(*alone), *flat_errors(plane, *ends)]
        np.testing.assert_array_equal(np.array(found), together[:, here])
    assert np.isnan(together).all(axis=0).tolist() == [False, True, False, False]


@pytest.mark.parametrize(
    ("crs", "says"),
    [
        ("EPSG:4326", "Geographic 2D CRS in degree, expected a projected one in metres"),
        ("EPSG:4978", "Geocentric CRS in metre, expected a projected one"),
        ("EPSG:4979", "Geographic 3D CRS in degree and metre, expected a projected one"),
        ("EPSG:2263", "US survey foot"),
        ("nonsense:1", "EPSG:32632"),
    ],
)
def test_a_crs_other_than_a_plane_in_metres_is_refused(crs: str, says: str) -> None:
    """Degrees, geocentric, feet and unknown codes are errors that suggest a valid code."""
    with pytest.raises(UsageError, match=says):
        EarthPlane(crs=crs)


def test_empty_arrays_give_empty_arrays() -> None:
    """Empty arrays give empty arrays."""
    plane, none = plane_of("utm"), np.zeros(0)
    pairs = (plane.to_plane(none, none), plane.to_earth(none, none), flat_errors(plane, none, none, none, none))
    assert [part.shape for pair in pairs for part in pair] == [(0,)] * 6
    assert plane.north_rad(none, none).shape == (0,)


def test_heights_of_a_crs_may_be_in_feet() -> None:
    """Only the plane of a compound CRS counts: heights in feet change nothing."""
    plain, with_heights = (EarthPlane(crs=crs) for crs in ("EPSG:26910", "EPSG:26910+6360"))
    x, y = np.array([5.1e5]), np.array([5.2e6])
    np.testing.assert_array_equal(with_heights.to_earth(x, y), plain.to_earth(x, y))
