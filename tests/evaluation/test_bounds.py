"""The Cramer-Rao bound, compared with the variance of the score."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.evaluation.bounds import bounds_of
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.information import INFORMATION
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.testing import CIRCLES


def test_bound_is_the_inverse_information():
    """The covariance is the inverse information, the rms the square root of its trace, with its ellipse."""
    generator = np.random.default_rng(1)
    factors = generator.normal(size=(50, 2, 2))
    matrices = factors @ factors.transpose(0, 2, 1)
    found = bounds_of(Symmetric2x2(matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]))
    inverses = np.linalg.inv(matrices)
    np.testing.assert_allclose(found.bound_xx_m2, inverses[:, 0, 0], rtol=1e-8)
    np.testing.assert_allclose(found.bound_xy_m2, inverses[:, 0, 1], rtol=1e-6)
    np.testing.assert_allclose(found.rms_m, np.sqrt(np.trace(inverses, axis1=1, axis2=2)), rtol=1e-8)
    np.testing.assert_allclose(found.semi_major_m**2 + found.semi_minor_m**2, found.rms_m**2, rtol=1e-8)


def test_singular_information_has_no_bound():
    """Zero, rank-one or NaN information has a bound of NaN, not infinity."""
    found = bounds_of(Symmetric2x2(np.array([0.0, 1.0, np.nan]), np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])))
    for values in vars(found).values():
        assert np.isnan(values).all()


def test_information_is_the_variance_of_the_score():
    """On mixed rows the information is the mean square of numerical derivatives of the log-likelihood."""
    trial = CIRCLES.trial(np.random.default_rng(2), 1, 6, None)
    batch = trial.batch
    source = batch.scene.reflectors[1].center + 1.06 * (
        batch.sensor_xy_m.mean(axis=1)[0] - batch.scene.reflectors[1].center
    )
    model = INFORMATION["bearings"]
    x, y = source[:1], source[1:]
    exact = model.seen_from(batch, x, y)
    information = model.at(exact, x, y)
    step = 1e-6 * trial.size_m

    def bearings(dx, dy):
        return model.seen_from(batch, x + dx, y + dy).bearing_rad[0]

    slopes = [
        np.angle(np.exp(1j * (bearings(dx, dy) - bearings(-dx, -dy)))) / (2.0 * step) / batch.bearing_std_rad[0]
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    seen = int(information.n_used[0])
    assert seen >= 4
    if seen == 6:
        expected = np.array([[a @ b for b in slopes] for a in slopes])
        found = np.array(
            [[information.matrix.xx[0], information.matrix.xy[0]], [information.matrix.xy[0], information.matrix.yy[0]]]
        )
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6 * np.trace(expected))


def test_rows_without_line_of_sight_do_not_count():
    """A sensor in the shadow of the earth has no information: the bound is that of the others."""
    spec = find_scenario("song-circle")
    world = spec.scene(spec.options())
    from nlosctl.contract.batches import BearingBatch

    angles = np.pi * np.array([0.10, -0.09, 0.55])
    sensor_xy = 6371e3 * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def batch_of(places):
        shape = (1, places.shape[0])
        return BearingBatch(
            scene=world,
            seed=np.zeros(1, dtype=np.uint64),
            sensor=np.arange(places.shape[0])[None],
            sensor_xy_m=np.asfortranarray(places[None]),
            bearing_rad=np.zeros(shape, order="F"),
            bearing_std_rad=np.full(shape, 0.01, order="F"),
            path=np.zeros(shape, dtype=np.int64),
            reflector=np.zeros(shape, dtype=np.int64),
        )

    model = INFORMATION["bearings"]
    x, y = np.array([6421e3]), np.zeros(1)
    found = [model.at(model.seen_from(batch_of(places), x, y), x, y) for places in (sensor_xy, sensor_xy[:2])]
    assert [int(information.n_used[0]) for information in found] == [2, 2]
    first, second = (bounds_of(information.matrix) for information in found)
    assert first.rms_m[0] == pytest.approx(second.rms_m[0], rel=1e-12)
