"""Targets common to the paths of a snapshot: several, extended, or none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenario_draws import draw_columns
from triplet_rooms import batch_of_paths, draw_clutter, draw_lone_scatterers, draw_room

from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.methods import triplets_chi2, triplets_joint
from nlosctl.scenarios import room


def joint(batch, **options):
    """Return the solution of ``joint``."""
    return triplets_joint.solve(batch, triplets_joint.JointOptions(**options))


def normalized_errors(estimates, truth):
    """Return the NEES (N,) of estimates at true positions (N, 2)."""
    error = estimates.position_m - truth
    xx, xy, yy = estimates.covariance_m2.T
    return (yy * error[:, 0] ** 2 - 2.0 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2) / (xx * yy - xy * xy)


def share_answered(estimates):
    """Return the share of rows that are ok or ambiguous."""
    return np.isin(estimates.status, (Status.OK, Status.AMBIGUOUS)).mean()


@pytest.mark.parametrize(
    ("snapshots", "receivers"),
    [(60, 3), pytest.param(401, 3, marks=pytest.mark.extensive), pytest.param(401, 4, marks=pytest.mark.extensive)],
)
def test_two_targets_among_their_detours_are_both_found(snapshots, receivers):
    """Of two targets that all receivers see directly both are found in 97 %, and P_f is that of single paths."""
    batch, indirect, target = draw_room(np.random.default_rng(5), snapshots, targets=2, receivers=receivers)
    solution = joint(batch, targets=2)
    estimates = solution.estimates
    found = np.zeros((snapshots, 2), dtype=bool)
    for one in range(2):
        near = normalized_errors(estimates, target[estimates.row, one]) < 20.0
        found[estimates.row[near & (estimates.status == Status.OK)], one] = True
    assert found.all(axis=1).mean() >= 0.97
    single = triplets_chi2.solve(batch, triplets_chi2.METHOD.options()).flags.columns["ip"]
    ip = solution.flags.columns["ip"]
    assert ip[~indirect].mean() <= single[~indirect].mean() + 0.01
    assert ip[indirect].mean() > 0.98


def test_a_second_target_is_not_made_of_detours():
    """With targets=2 and one target present, indirect paths remain indirect."""
    batch, indirect, _ = draw_room(np.random.default_rng(6), 100)
    one, two = (joint(batch, targets=targets).flags.columns["ip"] for targets in (1, 2))
    assert two[~indirect].mean() <= one[~indirect].mean() + 0.01
    assert two[indirect].mean() > 0.9


def test_a_room_without_a_direct_path_has_no_target():
    """Where every direct path is blocked the status is no_target, except for targets close to a wall."""
    columns = draw_columns("room", 400, seed=2, blocked_fraction=1.0)
    estimates = joint(batch_of_room(columns, 400)).estimates
    assert share_answered(estimates) <= 0.05
    assert (estimates.status == Status.NO_TARGET).mean() >= 0.95


def test_detours_that_meet_at_a_wall_are_no_sure_target():
    """With the walls in the scene hardly a snapshot without a direct path is ok; seen targets keep their status."""
    scene = room.scene(room.RoomOptions())
    for seed in (2, 3):
        columns = draw_columns("room", 400, seed=seed, blocked_fraction=1.0)
        batch = batch_of_room(columns, 400)
        assert (joint(batch).estimates.status == Status.OK).mean() > 0.02
        estimates = joint(dataclasses.replace(batch, scene=scene)).estimates
        assert (estimates.status == Status.OK).mean() <= 0.01
        assert (estimates.status == Status.AMBIGUOUS).any()
    batch = dataclasses.replace(
        batch_of_room(draw_columns("room", 300, seed=4, blocked_fraction=0.0), 300), scene=scene
    )
    assert (joint(batch).estimates.status == Status.OK).mean() >= 0.995


@pytest.mark.parametrize("receivers", [3, 5])
def test_a_target_on_a_wall_keeps_its_status(receivers):
    """A target on a wall with one direct path to each receiver is ok: it is no point where detours meet."""
    generator = np.random.default_rng(12)
    snapshots = 300
    half = 0.9 * np.array([5.0, 4.0])
    tx, rx = (generator.uniform(-half, half, (snapshots, count, 2)) for count in (1, receivers))
    target = generator.uniform(-half, half, (snapshots, 1, 2))
    target[:, :, 1] = 4.0
    out, back = target - tx, target - rx
    direct = np.broadcast_to(np.arctan2(out[..., 1], out[..., 0]), rx.shape[:2]), np.arctan2(back[..., 1], back[..., 0])
    length = np.hypot(out[..., 0], out[..., 1]) + np.hypot(back[..., 0], back[..., 1])
    batch = batch_of_paths(generator, np.broadcast_to(tx, rx.shape), rx, *direct, length)
    batch = dataclasses.replace(batch, scene=room.scene(room.RoomOptions()))
    without = joint(dataclasses.replace(batch, scene=Scene())).estimates.status == Status.OK
    assert (joint(batch).estimates.status == Status.OK)[without].mean() >= 0.92


def batch_of_room(columns, snapshots):
    """Return the batch of snapshots of equally many paths."""
    fields = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part].reshape(snapshots, -1)) for part in parts]
        fields[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    return TripletBatch(seed=np.zeros(snapshots, dtype=np.uint64), **fields)


@pytest.mark.parametrize("targets", [1, 2])
@pytest.mark.parametrize("draw", [draw_clutter, draw_lone_scatterers])
@pytest.mark.parametrize(
    ("paths", "snapshots"), [(4, 400), (8, 200), pytest.param(20, 100, marks=pytest.mark.extensive)]
)
def test_clutter_has_no_target(draw, paths, snapshots, targets):
    """At most 2 % of snapshots of unrelated paths have an answer."""
    batch = draw(np.random.default_rng(8), snapshots, paths)
    assert share_answered(joint(batch, targets=targets).estimates) <= 0.02


def test_a_seen_target_is_answered_and_covered():
    """With direct paths 99 % of snapshots are ok, and 95 % ellipses cover 95 % of the targets."""
    batch, _, target = draw_room(np.random.default_rng(9), 800)
    estimates = joint(batch).estimates
    fine = estimates.status == Status.OK
    assert fine.mean() > 0.99
    errors = normalized_errors(estimates, target[estimates.row, 0])[fine]
    assert np.mean(errors < 5.991) == pytest.approx(0.945, abs=0.025)
    assert np.mean(errors > 100.0) < 0.003


@pytest.mark.parametrize("radius_m", [0.3, pytest.param(0.5, marks=pytest.mark.extensive)])
def test_false_alarms_of_extended_targets_are_nominal(radius_m):
    """With ``target_radius_m``, as a parameter or a column, P_f is 5 %; as a point it is several times that."""
    batch, indirect, _ = draw_room(np.random.default_rng(10), 200, radius_m=radius_m)
    given = joint(batch, target_radius_m=radius_m).flags.columns["p_value"]
    assert np.mean(given[~indirect] < 0.05) == pytest.approx(0.05, abs=0.027)
    assert np.mean(given[indirect] < 0.05) > 0.85
    point = joint(batch).flags.columns["ip"]
    assert point[~indirect].mean() > 0.2
    column = np.full(indirect.shape, radius_m, order="F")
    np.testing.assert_array_equal(
        joint(dataclasses.replace(batch, target_radius_m=column)).flags.columns["p_value"], given
    )
    column[:] = np.nan
    np.testing.assert_array_equal(joint(dataclasses.replace(batch, target_radius_m=column)).flags.columns["ip"], point)


def test_points_among_extended_targets_keep_their_bytes():
    """A snapshot without a radius has the same result beside one with a radius."""
    batch, indirect, _ = draw_room(np.random.default_rng(11), 6)
    radius = np.zeros(indirect.shape, order="F")
    radius[3:] = 0.4
    alone = joint(batch).flags.columns["p_value"]
    beside = joint(dataclasses.replace(batch, target_radius_m=radius)).flags.columns["p_value"]
    np.testing.assert_array_equal(beside[:3], alone[:3])
    assert (beside[3:] != alone[3:]).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_false_alarms_of_joint_are_nominal_down_to_a_hundredth(seed):
    """P_f over 40,000 direct paths of the room is nominal within 20 % and three standard errors, to .01."""
    columns = draw_columns("room", 13_400, seed=seed, blocked_fraction=0.0)
    batch = batch_of_room(columns, 13_400)
    p_value = joint(batch).flags.columns["p_value"][~columns["truth_ip"].reshape(13_400, -1)]
    for level in (0.05, 0.01):
        error = 3.0 * np.sqrt(level / p_value.size)
        assert np.mean(p_value < level) == pytest.approx(level, abs=0.2 * level + error)
    assert np.mean(p_value < 0.001) < 0.002
