"""The methods for bearings, as parameters."""

from __future__ import annotations

import pytest

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import (
    bearings_ls,
    bearings_mixture_ml,
    bearings_ml,
    bearings_sequential,
    bearings_stansfield,
    bearings_suppress,
)

TRUSTING = (
    bearings_ls.METHOD,
    bearings_stansfield.METHOD,
    bearings_stansfield.FOCUSED,
    bearings_ml.METHOD,
    bearings_sequential.METHOD,
)
ROBUST = (bearings_mixture_ml.METHOD, bearings_suppress.METHOD)


@pytest.fixture(params=TRUSTING, ids=lambda spec: spec.name)
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each method for bearings that trusts every row, in turn."""
    spec: MethodSpec = request.param
    return spec


@pytest.fixture(params=(*TRUSTING, *ROBUST), ids=lambda spec: spec.name)
def any_method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each method for bearings in turn, those for outliers too."""
    spec: MethodSpec = request.param
    return spec
