"""Derivatives of scaled residuals by the offsets of the sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arrival_batches import arrival_batch
from batches import bearing_batch, range_batch

from nlosctl.contract.scene import CircleReflector, LineReflector, PlaneReflector, Scene, SphereReflector
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS

SENSORS = np.array([[0.0, 0.0], [100.0, 5.0], [40.0, 90.0]])
SOURCE = np.array([[45.0, 31.0], [60.0, 50.0]])
SCENE = Scene(reflectors=(LineReflector(name="wall", point=(0.0, -20.0), direction=(1.0, 0.1)),))


def by_difference(kind, batch, column, step):
    """Return the derivative of the residuals by an offset, which an opposite change of the measurements replaces."""
    ends = [
        SCALED_RESIDUALS[kind](
            replace(batch, **{column: getattr(batch, column) - sign * step}), SOURCE, with_ranges=False
        )[0].residual
        for sign in (1.0, -1.0)
    ]
    return (ends[0] - ends[1]) / (2.0 * step)


@pytest.mark.parametrize("reflector", [-1, [-1, 0, 0]])
def test_offsets_of_headings(reflector) -> None:
    """The derivative is that of a bearing that is larger by the offset, direct or by a mirror."""
    bearings = np.array([[0.6, 2.7, -1.6], [0.7, 2.3, -1.1]])
    batch = bearing_batch(SENSORS, bearings, [0.02, 0.01, 0.03], reflector, SCENE)
    (scalars,) = SCALED_RESIDUALS["bearings"](batch, SOURCE, with_ranges=False)
    expected = by_difference("bearings", batch, "bearing_rad", 1e-6)
    np.testing.assert_allclose(scalars.per_offset, expected, rtol=1e-6)


def test_offsets_of_headings_by_circles() -> None:
    """On a circle too, where the measured bearing moves the tangent that unfolds the row."""
    scene = Scene(reflectors=(CircleReflector(name="ring", center=(50.0, 40.0), radius=200.0),))
    batch = bearing_batch(SENSORS, [[0.6, 2.7, -1.6], [0.7, 2.3, -1.1]], 0.02, [-1, 0, -1], scene)
    (scalars,) = SCALED_RESIDUALS["bearings"](batch, SOURCE, with_ranges=False)
    assert scalars.measured.all()
    np.testing.assert_allclose(scalars.per_offset, by_difference("bearings", batch, "bearing_rad", 1e-6), rtol=1e-5)


def test_offsets_of_ranges() -> None:
    """A range that is longer by its offset leaves that much less: -1 / std."""
    batch = range_batch(SENSORS, [[50.0, 60.0, 55.0], [70.0, 60.0, 40.0]], [0.1, 0.2, 0.5])
    (scalars,) = SCALED_RESIDUALS["ranges"](batch, SOURCE, with_ranges=False)
    np.testing.assert_allclose(scalars.per_offset, by_difference("ranges", batch, "range_m", 1e-4), rtol=1e-9)


def test_ranges_beside_bearings_have_no_offset_of_the_heading() -> None:
    """The scalars of ranges in a batch of bearings do not depend on headings; their slopes are those of distances."""
    ranges = np.full((2, 3), 60.0)
    batch = bearing_batch(SENSORS, [[0.6, 2.7, -1.6], [0.7, 2.3, -1.1]], 0.02)
    batch = replace(batch, range_m=ranges, range_std_m=np.full((2, 3), 0.5))
    bearings, lengths = SCALED_RESIDUALS["bearings"](batch, SOURCE, with_ranges=True)
    assert bearings.per_offset is not None
    assert lengths.per_offset is None
    away = SOURCE[:, None] - SENSORS
    distance = np.hypot(*np.moveaxis(away, -1, 0))
    np.testing.assert_allclose(lengths.residual, (60.0 - distance) / 0.5)
    np.testing.assert_allclose(np.stack(lengths.slopes, axis=-1), -away / distance[..., None] / 0.5)


HEIGHTS = np.array([3.0, 8.0, 1.0])
IN_SPACE = np.column_stack([SOURCE, [12.0, 30.0]])
CEILING = Scene(
    reflectors=(
        PlaneReflector(name="ceiling", point=(0.0, 0.0, 60.0), normal=(0.1, 0.0, -1.0)),
        SphereReflector(name="layer", center=(50.0, 40.0, 0.0), radius=200.0),
    )
)


def directions(**columns):
    """Return a batch of azimuths and elevations near to those of the sources, the last row without an elevation."""
    away = IN_SPACE[:, None] - np.column_stack([SENSORS, HEIGHTS])
    azimuth = np.arctan2(away[..., 1], away[..., 0]) + 0.02
    elevation = np.arctan2(away[..., 2], np.hypot(away[..., 0], away[..., 1])) - 0.03
    elevation[:, 2] = np.nan
    height = np.asfortranarray(np.broadcast_to(HEIGHTS, azimuth.shape))
    batch = bearing_batch(SENSORS, azimuth, [0.02, 0.01, 0.03], dimension=3, sensor_z_m=height, elevation_rad=elevation)
    return replace(batch, **{"elevation_std_rad": np.where(np.isnan(elevation), np.nan, 0.02), **columns})


def turned(batch, by):
    """Return the scalars at the sources with the measured azimuths less ``by``."""
    return SCALED_RESIDUALS["bearings"](replace(batch, bearing_rad=batch.bearing_rad - by), IN_SPACE, with_ranges=False)


@pytest.mark.parametrize("reflector", [[-1, -1, -1], [-1, 0, 0], [1, 1, -1]])
def test_offsets_of_headings_in_space(reflector) -> None:
    """A heading turns the azimuth alone, direct, by a plane mirror or by a sphere; not the elevation."""
    batch = directions(reflector=np.asfortranarray(np.broadcast_to(reflector, (2, 3))), scene=CEILING)
    azimuths, elevations = turned(batch, 0.0)
    assert elevations.per_offset is None
    (after, rise), (before, fall) = turned(batch, 1e-6), turned(batch, -1e-6)
    expected = (after.residual - before.residual) / 2e-6
    np.testing.assert_allclose(azimuths.per_offset, expected, rtol=1e-5)
    np.testing.assert_allclose(rise.residual, fall.residual, atol=1e-9)


def test_offsets_of_headings_in_the_tangent_plane() -> None:
    """The derivative of the sum of squares is that of the azimuth's part alone, up to the square of a misfit of .03."""
    std = np.array([[0.02, 0.01, 0.03]] * 2)
    batch = directions(direction_std_rad=std)
    azimuths, _ = turned(batch, 0.0)
    expected = [sum(part.residual**2 for part in turned(batch, by)) for by in (1e-6, -1e-6)]
    np.testing.assert_allclose(
        2.0 * azimuths.residual * azimuths.per_offset, (expected[0] - expected[1]) / 2e-6, rtol=1e-3
    )
    np.testing.assert_allclose(azimuths.per_offset[:, 2], -1.0 / std[:, 2])


@pytest.mark.parametrize("dimension", [2, 3])
def test_offsets_of_arrivals(dimension: int) -> None:
    """An arrival that is later by its offset leaves that much less; what the snapshot's own takes is its derivative."""
    arrivals = [[50.0, 60.0, 55.5], [70.0, 60.5, 40.0]]
    sensors, sources = (SENSORS, SOURCE) if dimension == 2 else (np.column_stack([SENSORS, HEIGHTS]), IN_SPACE)
    batch = arrival_batch(sensors, arrivals, [0.1, 0.2, 0.5])
    (scalars,) = SCALED_RESIDUALS["arrivals"](batch, sources, with_ranges=False)
    np.testing.assert_allclose(scalars.per_offset, scalars.slopes[-1])
    assert len(scalars.slopes) == dimension + 1
    shifted = batch.arrival_m.copy()
    shifted[:, 1] -= 1e-4
    (after,) = SCALED_RESIDUALS["arrivals"](replace(batch, arrival_m=shifted), sources, with_ranges=False)
    change = (after.residual - scalars.residual) / 1e-4
    own = np.zeros((2, 3))
    own[:, 1] = scalars.per_offset[:, 1]
    common = (change - own) / scalars.slopes[-1]
    np.testing.assert_allclose(common, common[:, :1] * np.ones(3), atol=1e-7)
