"""Sets of targets: which are the same, and the steps that refine them."""

from __future__ import annotations

import numpy as np
import pytest
from triplet_worlds import batch_of

from nlosctl.models.triplets import predict_triplets
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel
from nlosctl.solvers.triplets.target_sets import refine_sets

TX, RX, TARGET = np.array([-3.0, 0.0]), np.array([3.0, 0.0]), np.array([0.5, 4.0])


def refined(apart_m, starts, targets):
    """Return the sets refined from starts (T, H, 2), for noise-free paths over two targets along x."""
    columns = {"tx_x_m": TX[0], "tx_y_m": TX[1], "rx_x_m": RX[0], "rx_y_m": RX[1]}
    columns |= {"dod_std_rad": 0.01, "doa_std_rad": 0.01, "path_length_std_m": 0.05}
    points = TARGET + np.array([[0.0, 0.0], [apart_m, 0.0]])
    dod, doa, length = predict_triplets(TX, RX, points)
    columns = {name: np.full(2, value) for name, value in columns.items()}
    flat = batch_of({**columns, "dod_rad": dod, "doa_rad": doa, "path_length_m": length})
    problem = TripletProblem.of_snapshots(flat, (np.zeros(2), np.zeros(2)))
    arrays = {
        name: getattr(problem, name).reshape(1, 2) for name in ("path_length_m", "inverse_length_std", "scatter_m2")
    }
    nodes = {name: getattr(problem, name).map(lambda array: array.reshape(1, 2)) for name in ("tx", "rx")}
    model = TargetModel(prior_indirect=0.5, clutter=0.01, targets=targets)
    starts = np.asarray(starts)[..., None, :] + TARGET
    return refine_sets(
        TripletProblem(**nodes, **arrays), (starts[..., 0], starts[..., 1]), model, np.array([9.0])
    ), points


@pytest.mark.parametrize(("apart_m", "distinct"), [(0.03, False), (0.35, True)])
def test_targets_are_distinct_beyond_three_standard_deviations(apart_m, distinct):
    """Two hypotheses three standard deviations apart are two; a set that repeats a better one is not valid."""
    sets, _ = refined(apart_m, [[[0.0, 0.0], [apart_m, 0.0]]], 1)
    dx, dy = (part[0, 1] - part[0, 0] for part in sets.point)
    distance = np.sqrt(sets.information.at(0, 0).quadratic_form(dx, dy))[0]
    assert (3.0 < distance < 12.0) == distinct
    assert sets.valid[:, 0].tolist() == [True, distinct]


def test_pairs_in_the_other_order_are_the_same():
    """A pair is refined to both targets, each path to its own; the same pair in the other order is not valid."""
    sets, points = refined(1.5, [[[0.1, 0.0], [1.4, 0.1]], [[1.4, 0.1], [0.1, 0.0]]], 2)
    assert sets.valid[:, 0].tolist() == [True, False]
    for order in range(2):
        found = np.stack([part[:, order, 0] for part in sets.point], axis=1)
        np.testing.assert_allclose(found[np.argsort(found[:, 0])], points, atol=1e-3)
    np.testing.assert_allclose(sets.score[0], sets.score[1])


def test_a_set_of_one_target_twice_is_not_valid():
    """Two targets of a set at one position are one."""
    sets, _ = refined(0.0, [[[0.0, 0.0]], [[0.0, 0.0]]], 2)
    assert sets.valid.tolist() == [[False]]
