"""The laws on bearings by circles, for the methods that solve them."""

from __future__ import annotations

from typing import Any

import pytest

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import bearings_ls, bearings_ml, bearings_ml_grid, bearings_stansfield
from nlosctl.testing import CIRCLES, LAWS, MethodLaw, check_law

CASES = {
    "ls": (bearings_ls.METHOD, None),
    "stansfield": (bearings_stansfield.METHOD, None),
    "stansfield-focused": (bearings_stansfield.FOCUSED, None),
    "ml": (bearings_ml.METHOD, None),
    "ml feasible": (bearings_ml.METHOD, bearings_ml.MaximumLikelihoodOptions(feasible=True)),
    "ml-grid": (bearings_ml_grid.METHOD, bearings_ml_grid.GridOptions(step_m=40e3)),
}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize(
    "case", ["ls", *(pytest.param(case, marks=pytest.mark.extensive) for case in CASES if case != "ls")]
)
def test_a_method_obeys_the_law_on_circles(case: str, law: MethodLaw) -> None:
    """Each law holds on rows by one or two layers over ground and by an open circle, mixed with others."""
    spec: MethodSpec
    options: Any
    spec, options = CASES[case]
    check_law(spec, law, options=options, draw=CIRCLES)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
@pytest.mark.parametrize("case", [case for case in CASES if case != "ml feasible"])
def test_a_method_obeys_the_laws_on_many_draws(case: str, seed: int) -> None:
    """The laws hold on other draws with circles."""
    spec, options = CASES[case]
    for law in LAWS:
        check_law(spec, law, seed=seed, options=options, draw=CIRCLES)
