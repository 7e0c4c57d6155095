"""Derivatives of scaled residuals by the offsets of the sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from batches import bearing_batch, range_batch

from nlosctl.contract.scene import CircleReflector, LineReflector, Scene
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
