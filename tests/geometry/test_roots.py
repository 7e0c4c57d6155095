"""Bracketed roots, compared with functions whose roots are known."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.roots import bracketed_roots


def test_roots_are_found_where_newton_alone_fails():
    """Flat, steep and oscillating functions converge to the root in the bracket."""
    scale = np.array([1e-6, 1.0, 1e6, 50.0])
    exact = np.array([0.3, -0.7, 0.999, -0.999])

    def function(at):
        shifted = scale * (at - exact)
        return np.arctan(shifted) + shifted**3, scale * (1.0 / (1.0 + shifted**2) + 3.0 * shifted**2)

    found = bracketed_roots(function, np.full(4, -1.0), np.full(4, 1.0), np.array([-0.99, 0.99, -0.99, 0.99]))
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_rows_are_independent():
    """Bits of a row do not depend on the others, and NaN stays in its row."""
    exact = np.array([0.1, np.nan, 0.9])

    def function_of(target):
        return lambda at: (at**3 - target**3, 3.0 * at**2)

    together = bracketed_roots(function_of(exact), np.zeros(3), np.ones(3), np.full(3, 0.5))
    alone = [bracketed_roots(function_of(exact[[i]]), np.zeros(1), np.ones(1), np.full(1, 0.5))[0] for i in range(3)]
    np.testing.assert_array_equal(together, alone)
    assert np.isnan(together).tolist() == [False, True, False]


def visited(function, guess):
    """Return the points at which a function of one variable is evaluated, and the root found, in [-1, 1]."""
    places = []

    def recording(at):
        places.append(float(at[0]))
        return function(at)

    root = bracketed_roots(recording, np.array([-1.0]), np.array([1.0]), np.array([guess]))
    return places, float(root[0])


def test_an_exact_newton_step_is_the_last():
    """A linear function is solved in one step, even if its value rounds to just below zero."""
    for residue in (0.0, 1e-300):
        assert visited(lambda at, residue=residue: ((at + 0.5) - residue, np.ones(1)), 0.25) == ([0.25, -0.5], -0.5)


def test_steps_out_of_the_bracket_become_bisections():
    """If a Newton step leaves the bracket, its middle is next."""
    places, root = visited(lambda at: (at + 0.5, np.full(1, 0.1)), 0.25)
    assert places[:2] == [0.25, -0.375]
    assert abs(root + 0.5) < 1e-12


def test_slow_newton_steps_become_bisections():
    """At a root of high order bisection converges before the iteration limit."""
    for order in (3, 9):
        places, root = visited(lambda at, order=order: ((at - 0.7) ** order, order * (at - 0.7) ** (order - 1)), -0.6)
        assert abs(root - 0.7) < 1e-11
        assert len(places) < 100


def test_roots_outside_the_bracket_are_not_returned() -> None:
    """If a Newton step leads to another root beside the bracket, the one inside is found."""

    def wave(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turn = np.pi / 0.8
        return np.sin(turn * (x - 0.5)), turn * np.cos(turn * (x - 0.5))

    found = bracketed_roots(wave, np.array([-0.2]), np.array([1.25]), np.array([1.15]))
    np.testing.assert_allclose(found, [0.5], atol=1e-12)


def test_zero_slopes_become_bisections() -> None:
    """A zero slope at the start or the root, and a step from -1e200 to 1e200, still converge."""

    def cubic(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x**3 - 3.0 * x - 1.0, 3.0 * x**2 - 3.0

    def cube(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x**3, 3.0 * x**2

    def step(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.copysign(1e200, x - 0.3), np.full_like(x, 1e-200)

    for function, low, high, guess, root in (
        (cubic, 0.5, 3.0, 1.0, 2.0 * np.cos(np.pi / 9.0)),
        (cube, -1.0, 2.0, 0.0, 0.0),
        (step, -1.0, 2.0, 1.0, 0.3),
    ):
        found = bracketed_roots(function, np.array([low]), np.array([high]), np.array([guess]))
        np.testing.assert_allclose(found, [root], atol=2e-12)
