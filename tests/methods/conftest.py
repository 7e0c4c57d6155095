"""The methods for bearings, as parameters."""

from __future__ import annotations

import pytest

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield

METHODS = (bearings_ls.METHOD, bearings_stansfield.METHOD, bearings_stansfield.FOCUSED, bearings_ml.METHOD)


@pytest.fixture(params=METHODS, ids=lambda spec: spec.name)
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each method for bearings in turn."""
    spec: MethodSpec = request.param
    return spec
