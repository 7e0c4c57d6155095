"""The methods for bearings, as parameters."""

from __future__ import annotations

import pytest

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield, bearings_stansfield_focused

METHODS = (bearings_ls, bearings_stansfield, bearings_stansfield_focused, bearings_ml)


@pytest.fixture(params=METHODS, ids=lambda module: module.METHOD.name)
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each method for bearings in turn."""
    spec: MethodSpec = request.param.METHOD
    return spec
