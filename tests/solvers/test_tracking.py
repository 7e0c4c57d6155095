"""Paths through fixes: the block-tridiagonal system, the smoother and the filter against the textbook's recursions."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.solvers.tracking.acceleration import close_times
from nlosctl.solvers.tracking.block_tridiagonal import BlockTridiagonal
from nlosctl.solvers.tracking.motion import Motion
from nlosctl.solvers.tracking.states import order_states
from nlosctl.solvers.tracking.tracks_of_fixes import TracksOfFixes, track_fixes

FloatArray = np.ndarray

_PRIOR_M2 = 1e6


def blocks_of(matrix: FloatArray, d: int) -> FloatArray:
    """The diagonal blocks of a matrix."""
    return np.stack([matrix[i : i + d, i : i + d] for i in range(0, matrix.shape[0], d)])


def dense(diagonal: FloatArray, coupling: FloatArray, within: FloatArray) -> FloatArray:
    """The whole matrix of a block-tridiagonal system."""
    size, d = diagonal.shape[:2]
    whole = np.zeros((size * d, size * d))
    for i in range(size):
        at = slice(i * d, i * d + d)
        whole[at, at] = diagonal[i]
        if i + 1 < size and within[i + 1] > 0:
            after = slice(i * d + d, i * d + 2 * d)
            whole[at, after], whole[after, at] = coupling[i], coupling[i].T
    return whole


def textbook(
    time: FloatArray, position: FloatArray, covariance: FloatArray, has: FloatArray, q: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The Kalman filter and the Rauch-Tung-Striebel smoother in covariance form, from a wide prior."""
    size, axes = position.shape
    d, unit = 2 * axes, np.eye(axes)
    measured = np.hstack([unit, np.zeros((axes, axes))])
    state, spread = np.zeros(d), np.eye(d) * _PRIOR_M2
    filtered, predicted, steps = [], [], []
    for k in range(size):
        if k:
            h = time[k] - time[k - 1]
            step = np.kron([[1.0, h], [0.0, 1.0]], unit)
            noise = q * np.kron([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]], unit)
            state, spread = step @ state, step @ spread @ step.T + noise
            steps.append(step)
        predicted.append((state, spread))
        if has[k]:
            gain = spread @ measured.T @ np.linalg.inv(measured @ spread @ measured.T + covariance[k])
            state = state + gain @ (position[k] - measured @ state)
            keep = np.eye(d) - gain @ measured
            spread = keep @ spread @ keep.T + gain @ covariance[k] @ gain.T
        filtered.append((state, spread))
    smoothed = [filtered[-1]]
    for k in range(size - 2, -1, -1):
        gain = filtered[k][1] @ steps[k].T @ np.linalg.inv(predicted[k + 1][1])
        state = filtered[k][0] + gain @ (smoothed[0][0] - predicted[k + 1][0])
        spread = filtered[k][1] + gain @ (smoothed[0][1] - predicted[k + 1][1]) @ gain.T
        smoothed.insert(0, (state, spread))
    both = (np.array([pair[part] for pair in pairs]) for pairs in (filtered, smoothed) for part in (0, 1))
    return tuple(both)  # type: ignore[return-value]


def walk(axes: int, q: float, size: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Times, noisy positions, their covariances, and which are there."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, size))
    truth = np.cumsum(np.cumsum(rng.normal(size=(size, axes)) * np.sqrt(q), axis=0), axis=0)
    roots = rng.normal(size=(size, axes, axes)) * 0.5
    covariance = roots @ roots.transpose(0, 2, 1) + 0.2 * np.eye(axes)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(size, axes)))
    has = rng.uniform(size=size) > 0.2
    has[:3] = True
    return time, truth + noise, covariance, has


def solved(
    time: FloatArray, position: FloatArray, covariance: FloatArray, q: float, causal: bool = False
) -> TracksOfFixes:
    """One track through fixes."""
    key = np.zeros(time.shape, dtype=np.int64)
    return track_fixes(key, time, position, covariance, q, gap_s=np.inf, causal=causal)


@pytest.mark.parametrize("d", [4, 6])
def test_solutions_inverses_and_determinants_are_those_of_the_dense_matrix(d: int) -> None:
    """Tracks of any length are solved together as by a dense solver."""
    rng = np.random.default_rng(1)
    within = np.concatenate([np.arange(size) for size in (1, 2, 3, 7, 8, 21)])
    roots = rng.normal(size=(within.size, d, d))
    diagonal = roots @ roots.transpose(0, 2, 1) + 6.0 * np.eye(d)
    coupling = 0.5 * rng.normal(size=diagonal.shape)
    whole, right = dense(diagonal, coupling, within), rng.normal(size=(within.size, d))
    system = BlockTridiagonal(diagonal, coupling, within)
    np.testing.assert_allclose(system.solve(right).ravel(), np.linalg.solve(whole, right.ravel()), atol=1e-12)
    np.testing.assert_allclose(system.inverse_blocks(), blocks_of(np.linalg.inv(whole), d), atol=1e-12)
    assert system.log_determinant.sum() == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-12)
    assert not system.singular.any()


def test_a_track_has_the_same_bits_alone_and_among_others() -> None:
    """The solution of a track does not depend on the tracks before and after it."""
    rng = np.random.default_rng(2)
    sizes = (5, 13, 6)
    within = np.concatenate([np.arange(size) for size in sizes])
    motion = Motion.of(within, rng.uniform(0.1, 1.0, within.size).cumsum(), 0.3)
    diagonal, coupling = motion.blocks(2)
    diagonal[:, range(2), range(2)] += 1.0
    right = rng.normal(size=(within.size, 4))
    mine = slice(5, 18)
    every, alone = (BlockTridiagonal(diagonal[at], coupling[at], within[at]) for at in (slice(None), mine))
    assert (every.solve(right)[mine] == alone.solve(right[mine])).all()
    assert (every.inverse_blocks()[mine] == alone.inverse_blocks()).all()


@pytest.mark.parametrize("axes", [2, 3])
def test_the_gradient_of_the_motion_is_its_matrix_times_the_states(axes: int) -> None:
    """Cost, gradient and matrix of the motion agree, in the plane and in space."""
    rng = np.random.default_rng(3)
    within = np.array([0, 1, 2, 0, 1, 0])
    motion = Motion.of(within, np.array([0.0, 0.7, 1.9, 5.0, 5.5, 7.0]), 0.3)
    matrix = dense(*motion.blocks(axes), within)
    states = rng.normal(size=(6, 2 * axes))
    np.testing.assert_allclose(motion.gradient(states).ravel(), matrix @ states.ravel(), atol=1e-10)
    assert motion.cost(states).sum() == pytest.approx(0.5 * states.ravel() @ matrix @ states.ravel())


@pytest.mark.parametrize(("axes", "q"), [(2, 0.05), (3, 0.5)])
def test_the_smoother_and_the_filter_are_those_of_the_textbook(axes: int, q: float) -> None:
    """States within 1e-5 standard deviations and covariances within 1e-6 of the trace, also without some positions."""
    time, position, covariance, has = walk(axes, q, 150, axes)
    filtered, spread_filtered, smoothed, spread_smoothed = textbook(time, position, covariance, has, q)
    seen = np.where(has[:, None], position, np.nan)
    for causal, states, spread in ((False, smoothed, spread_smoothed), (True, filtered, spread_filtered)):
        found = solved(time, seen, covariance, q, causal)
        mine = found.states.copy()
        mine[:, :axes] += found.origin_m
        late = slice(10, None)  # the first states of the textbook depend on its prior
        std = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        assert np.abs((mine - states) / std)[late].max() < 2e-5
        off = np.abs(found.covariance - spread).max(axis=(1, 2)) / np.trace(spread, axis1=1, axis2=2)
        assert off[late].max() < 1e-6
        assert found.known.all()
    assert not solved(time, seen, covariance, q, causal=True).moving[0]


def test_the_filter_ends_at_the_smoother() -> None:
    """The last state of the filter is that of the smoother, also in two thousand steps and in any order of the rows."""
    time, position, covariance, _ = walk(2, 0.1, 2000, 7)
    order = np.random.default_rng(0).permutation(time.size)
    last = int(np.argmax(time[order]))
    one = solved(time[order], position[order], covariance[order], 0.1)
    other = solved(time[order], position[order], covariance[order], 0.1, causal=True)
    np.testing.assert_allclose(one.states[last], other.states[last], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(one.covariance[last], other.covariance[last], rtol=1e-8)


def test_many_fixes_within_microseconds_keep_their_digits() -> None:
    """Rows a microsecond apart count as several fixes of one state: as one fix of the combined covariance."""
    time = np.arange(20.0)
    thrice = np.concatenate([time, time + 1e-6, time + 2e-6])
    position = np.stack([np.sin(time), np.cos(time)], axis=1)
    unit = np.tile(np.eye(2), (20, 1, 1))
    one = solved(time, position, unit / 3.0, 0.1)
    many = solved(thrice, np.tile(position, (3, 1)), np.tile(unit, (3, 1, 1)), 0.1)
    np.testing.assert_allclose(many.states[:20], one.states, atol=1e-5)
    np.testing.assert_allclose(many.covariance[:20], one.covariance, atol=1e-5)


def test_what_is_not_known_is_not_stated() -> None:
    """A lone fix has no velocity; one fix among several snapshots is no path; equal times are one state."""
    unit = np.tile(np.eye(2), (6, 1, 1))
    key = np.array([0, 1, 1, 1, 2, 2])
    time = np.array([0.0, 0.0, 1.0, 2.0, 5.0, 5.0])
    position = np.array([[1.0, 2.0], [0, 0], [np.nan, 0], [0, np.nan], [2.0, 2.0], [4.0, 2.0]])
    found = track_fixes(key, time, position, unit, 0.1, gap_s=np.inf, causal=False)
    assert found.known.tolist() == [True, False, False, False, True, True]
    assert not found.moving.any()
    np.testing.assert_allclose((found.states[:, :2] + found.origin_m)[[0, 4, 5]], [[1, 2], [3, 2], [3, 2]])
    np.testing.assert_allclose(found.covariance[4, :2, :2], 0.5 * np.eye(2))


def test_gaps_split_tracks_in_order_of_time() -> None:
    """A gap longer than the limit begins a new part, numbered by time within the key; order does not matter."""
    key = np.array([1, 0, 0, 1, 0, 0])
    of = order_states(key, np.array([3.0, 10.0, 0.0, 1.0, 11.0, 1.0]), 5.0, np.zeros(6))
    assert of.part.tolist() == [0, 1, 0, 0, 1, 0]
    assert of.within.tolist() == [0, 1, 0, 1, 0, 1]
    assert of.time_s.tolist() == [0.0, 1.0, 10.0, 11.0, 1.0, 3.0]


def test_the_density_is_that_of_the_simulated_motion() -> None:
    """The maximum of the marginal likelihood is near the truth, and the evidence that of a Gaussian of all fixes."""
    rng = np.random.default_rng(5)
    size, q = 400, 0.2
    noise = q * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
    steps = rng.normal(size=(2, size, 2)) @ np.linalg.cholesky(noise).T
    state, path = np.zeros((2, 2)), []
    for k in range(size):
        state = np.stack([state[:, 0] + state[:, 1], state[:, 1]], axis=1) + steps[:, k]
        path.append(state[:, 0])
    position = np.array(path) + rng.normal(size=(size, 2))
    unit = np.tile(np.eye(2), (size, 1, 1))
    found = track_fixes(np.zeros(size, int), np.arange(float(size)), position, unit, None, gap_s=np.inf, causal=False)
    assert found.density.is_maximum
    assert 0.12 < found.density.density < 0.32
    straight = np.arange(20.0)[:, None] * np.ones(2)
    flat = track_fixes(np.zeros(20, int), np.arange(20.0), straight, unit[:20], None, gap_s=np.inf, causal=False)
    assert not flat.density.is_maximum


def test_close_times_grow_with_the_stiffness() -> None:
    """The time within which snapshots are one state is the cube root of variance over density."""
    close = close_times(np.array([0, 0, 1]), np.array([8.0, np.nan, np.nan]), 1e-7)
    assert close == pytest.approx([0.2, 0.2, 0.0])
