"""The concentration of the von Mises distribution, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import i0e, i1e

from nlosctl.solvers.bearings.von_mises import concentration


def test_concentration_inverts_the_mean_cosine():
    """I1(kappa) / I0(kappa) is the mean cosine, from 1e-3 to 1e4; a spread of 1 and more has kappa 0, 0 infinite."""
    kappa = np.geomspace(1e-3, 1e4, 200)
    assert concentration(1.0 - i1e(kappa) / i0e(kappa)) == pytest.approx(kappa, rel=1e-7)
    assert concentration(np.array([1.0, 1.5, 0.0])).tolist() == [0.0, 0.0, np.inf]
    assert concentration(np.array([1e-14])) == pytest.approx(5e13, rel=1e-9)
