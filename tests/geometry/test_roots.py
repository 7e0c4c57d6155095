"""Bracketed roots, against functions whose roots are known."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.roots import bracketed_roots


def test_roots_are_found_where_newton_alone_fails():
    """Flat, steep and oscillating starts end in the bracket's root."""
    scale = np.array([1e-6, 1.0, 1e6, 50.0])
    exact = np.array([0.3, -0.7, 0.999, -0.999])

    def function(at):
        shifted = scale * (at - exact)
        return np.arctan(shifted) + shifted**3, scale * (1.0 / (1.0 + shifted**2) + 3.0 * shifted**2)

    found = bracketed_roots(function, np.full(4, -1.0), np.full(4, 1.0), np.array([-0.99, 0.99, -0.99, 0.99]))
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_rows_are_independent():
    """A row has the same bits whatever the others are, and NaN stays alone."""
    exact = np.array([0.1, np.nan, 0.9])

    def function_of(target):
        return lambda at: (at**3 - target**3, 3.0 * at**2)

    together = bracketed_roots(function_of(exact), np.zeros(3), np.ones(3), np.full(3, 0.5))
    alone = [bracketed_roots(function_of(exact[[i]]), np.zeros(1), np.ones(1), np.full(1, 0.5))[0] for i in range(3)]
    np.testing.assert_array_equal(together, alone)
    assert np.isnan(together).tolist() == [False, True, False]
