"""Cases of structured candidate sets in simulated scenes with known points."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField
from nlosctl.evaluation.targets import CASES
from nlosctl.reproduce.liang.candidate_sets import CandidateSets, candidate_sets
from nlosctl.solvers.echoes.structured_sets import ClusteringOptions

SENSORS = np.array([[0.0, -90.0], [80.0, 40.0], [-80.0, 55.0]])
TARGETS = np.array([[20.0, 30.0], [-45.0, -20.0]])
SCATTERER = np.array([10.0, 60.0])


def candidates(scattered: bool, std: float = 0.0) -> tuple[CandidateSets, np.ndarray, np.ndarray]:
    """Return the candidates of two targets and three sensors, with or without a scatterer."""
    ranges, sensor, target, los = [], [], [], []
    for place, xy in enumerate(SENSORS):
        for number, point in enumerate(TARGETS):
            direct = np.hypot(*(point - xy))
            ranges.append(direct)
            if scattered:
                ranges.append(0.5 * (direct + np.hypot(*(point - SCATTERER)) + np.hypot(*(SCATTERER - xy))))
            kinds = [True, False] if scattered else [True]
            sensor += [place] * len(kinds)
            target += [number] * len(kinds)
            los += kinds
    noise = std * np.random.default_rng(3).standard_normal(len(ranges))
    block = np.asfortranarray(np.array(ranges)[None] + noise)
    batch = RangeBatch(
        seed=np.zeros(1, dtype=np.uint64),
        field=BoxField(xmin_m=-100.0, xmax_m=100.0, ymin_m=-100.0, ymax_m=100.0),
        sensor=np.array(sensor)[None],
        sensor_xy_m=np.asfortranarray(SENSORS[sensor][None]),
        range_m=block,
        range_std_m=np.full(block.shape, 1.0),
        path=np.full(block.shape, -1),
        sensor_height_m=np.zeros(block.shape),
    )
    truth = np.array(target), np.array(los)
    return candidate_sets(batch, 0, *truth, ClusteringOptions()), *truth


def places(found: CandidateSets, *cases: str) -> np.ndarray:
    """Return the positions of the sets of some cases."""
    return np.flatnonzero(np.isin(found.case, [CASES.index(case) for case in cases]))


def test_the_true_sets_of_exact_ranges_are_points() -> None:
    """Each target has one set of case (i), its direct circles, with zero spread; none with a TIP is selected."""
    found, target, los = candidates(scattered=True)
    true = places(found, "i")
    assert sorted(set(target[found.row[true]].ravel())) == [0, 1]
    assert los[found.row[true]].all()
    assert (target[found.row[true]] == target[found.row[true][:, :1]]).all()
    assert found.spread_m[true] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert found.kept[true].all()
    assert not found.kept[places(found, "ii", "iii")].any()


def test_a_tip_has_two_direct_circles_of_one_target() -> None:
    """Sets of cases (ii) and (iii) have two direct rows of one target, and a larger spread than the true set."""
    found, target, los = candidates(scattered=True, std=0.5)
    some = places(found, "ii", "iii")
    assert some.size
    for row in found.row[some]:
        assert np.bincount(target[row][los[row]]).max() >= 2
    assert found.larger[some].all()
    assert found.spread_m[some].min() > found.spread_m[places(found, "i")].min()


def test_cases_by_the_kind_of_circles() -> None:
    """(ii) and (iv) have only direct circles, (iii) and (v) both kinds, (vi) only scattered ones."""
    found, _, los = candidates(scattered=True, std=0.5)
    direct = los[found.row]
    assert direct[places(found, "i", "ii", "iv")].all()
    mixed = direct[places(found, "iii", "v")]
    assert mixed.any(axis=1).all()
    assert not mixed.all(axis=1).any()
    assert not direct[places(found, "vi")].any()
    assert places(found, "vi").size


def test_without_scatterers_every_circle_is_direct() -> None:
    """With direct echoes only there are no sets of case (iii), (v) or (vi)."""
    found, _, _ = candidates(scattered=False, std=0.5)
    assert not places(found, "iii", "v", "vi").size
    assert places(found, "ii", "iv").size
    assert np.all(np.diff(found.spread_m) >= 0.0)


def test_the_points_lie_on_their_circles() -> None:
    """The spread is that of the points, and each point is on two circles of the set."""
    found, _, _ = candidates(scattered=False)
    away = found.point_m - found.point_m.mean(axis=1, keepdims=True)
    assert np.sqrt((away**2).sum(axis=(1, 2))) == pytest.approx(found.spread_m)
    true = places(found, "i")
    nearest = np.abs(found.point_m[true][:, :, None] - TARGETS).max(axis=-1).min(axis=-1)
    assert nearest == pytest.approx(np.zeros((2, 3)), abs=1e-6)
