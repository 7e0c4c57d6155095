"""Targets assigned to tracks: against the truth of a simulation, brute force, births and deaths."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from nlosctl.solvers.tracking.assigned_fixes import AssociationRule, associate_fixes

RULE = AssociationRule(density=0.1, speed_std_m_s=10.0, gate_probability=1e-4, misses=3)


def walk(seed: int, targets: int, scans: int, dimension: int = 2) -> tuple[np.ndarray, ...]:
    """Return scan, time, fixes, covariances and the true target of objects in straight motion, in random order."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform(0.0, 500.0, (targets, dimension)), rng.normal(0.0, 3.0, (targets, dimension))
    scan, target = (part.ravel() for part in np.meshgrid(np.arange(scans), np.arange(targets), indexing="ij"))
    order = rng.permutation(scan.size)
    scan, target = scan[order], target[order]
    place = start[target] + speed[target] * scan[:, None] + rng.normal(0.0, 2.0, (scan.size, dimension))
    return scan, scan.astype(float), place, np.tile(4.0 * np.eye(dimension), (scan.size, 1, 1)), target


def test_far_targets_keep_their_tracks() -> None:
    """Targets that stay apart are one track each, in the plane and in space, whatever the order of the rows."""
    for dimension in (2, 3):
        scan, time, place, covariance, target = walk(1, 4, 30, dimension)
        track = associate_fixes(scan, time, place, covariance, RULE)
        pairs = set(zip(track.tolist(), target.tolist(), strict=True))
        assert len(pairs) == 4
        assert sorted({number for number, _ in pairs}) == [0, 1, 2, 3]


def test_an_assignment_is_the_best_of_all() -> None:
    """Of near targets the assignment has the least sum of squared Mahalanobis distances of all permutations."""
    rng = np.random.default_rng(2)
    spread = np.linalg.inv(2.0 * np.eye(2) + (RULE.speed_std_m_s**2 + RULE.density / 3.0) * np.eye(2))
    for _ in range(20):
        first = rng.normal(0.0, 8.0, (4, 2))
        second = first + rng.normal(0.0, 4.0, (4, 2))

        def cost(order: tuple[int, ...], first: np.ndarray = first, second: np.ndarray = second) -> float:
            return sum(float((second[i] - first[j]) @ spread @ (second[i] - first[j])) for i, j in enumerate(order))

        best = min(permutations(range(4)), key=cost)
        scan = np.repeat([0, 1], 4)
        place = np.concatenate([first, second])
        track = associate_fixes(scan, scan.astype(float), place, np.tile(np.eye(2), (8, 1, 1)), RULE)
        assert track[:4].tolist() == [0, 1, 2, 3]
        assert track[4:].tolist() == list(best)


def test_crossing_targets_are_distinguished_by_their_velocities() -> None:
    """Two targets that pass through one point at one time continue straight on."""
    scan = np.repeat(np.arange(21), 2)
    along = 10.0 * (np.arange(21) - 10.0)
    place = np.stack([np.stack([along, 0.2 * along], axis=1), np.stack([along, -0.2 * along], axis=1)], axis=1)
    place = place.reshape(-1, 2)
    track = associate_fixes(scan, scan.astype(float), place, np.tile(0.25 * np.eye(2), (42, 1, 1)), RULE)
    assert (track[0::2] == track[0]).sum() >= 20
    assert track[0] == track[-2] != track[1] == track[-1]


def test_births_deaths_and_unknown_fixes() -> None:
    """A target far away begins a track; a track missed too often ends; a fix without a position has none."""
    place = np.array([[0.0, 0.0], [400.0, 0.0], [0.5, 0.0], [np.nan, 0.0], [0.0, 0.5], [0.2, 0.1], [0.3, 0.2]])
    scan = np.array([0, 1, 1, 2, 3, 4, 9])
    covariance = np.tile(np.eye(2), (7, 1, 1))
    track = associate_fixes(scan, scan.astype(float), place, covariance, RULE)
    assert track.tolist() == [0, 1, 0, -1, 0, 0, 0]
    empty = np.full((3, 2), np.nan)
    more = np.concatenate([place[:6], empty, place[6:]])
    scans = np.concatenate([scan[:6], [5, 6, 7], scan[6:]])
    late = associate_fixes(scans, scans.astype(float), more, np.tile(np.eye(2), (10, 1, 1)), RULE)
    assert late.tolist() == [0, 1, 0, -1, 0, 0, -1, -1, -1, 2]
