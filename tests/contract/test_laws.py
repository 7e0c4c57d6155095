"""Every built-in method obeys every law."""

from __future__ import annotations

import pytest
from method_options import BUILT_IN, options_of

from nlosctl import registry
from nlosctl.testing import LAWS, MethodLaw, check_law
from nlosctl.testing.draws import Draw
from nlosctl.testing.space_draws import space_draws_of

QUICK = {"bearings.stansfield", "ranges.sr-ls"}
"""Methods whose laws `make test-fast` checks; every other run checks all."""

ENTRIES = [
    pytest.param(entry, id=entry.full_name, marks=[pytest.mark.extensive] * (entry.full_name not in QUICK))
    for entry in BUILT_IN
]


def test_built_in_methods_are_registered() -> None:
    """The registry lists the methods of this package, so that the tests below check something."""
    assert {"bearings.ls", "bearings.stansfield", "bearings.ml"} <= {entry.full_name for entry in BUILT_IN}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("entry", ENTRIES)
def test_a_built_in_method_obeys_the_law(entry: registry.MethodEntry, law: MethodLaw) -> None:
    """A built-in method obeys every law."""
    check_law(registry.load(entry), law, options=options_of(entry))


IN_SPACE = [
    pytest.param(
        entry,
        draw,
        id=f"{entry.full_name}-{number}",
        marks=[] if entry.full_name in {"bearings.ls", "bearings.stansfield"} else [pytest.mark.slow],
    )
    for entry in BUILT_IN
    for number, draw in enumerate(space_draws_of(registry.load(entry)))
]


@pytest.mark.extensive
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize(("entry", "draw"), IN_SPACE)
def test_a_built_in_method_obeys_the_law_in_space(entry: registry.MethodEntry, draw: Draw, law: MethodLaw) -> None:
    """A method that declares three dimensions obeys every law on batches in space."""
    check_law(registry.load(entry), law, options=options_of(entry), draw=draw)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 101))
@pytest.mark.parametrize("entry", ENTRIES)
def test_a_built_in_method_obeys_the_laws_on_many_draws(entry: registry.MethodEntry, seed: int) -> None:
    """A built-in method obeys every law on a hundred other draws."""
    spec = registry.load(entry)
    for law in LAWS:
        check_law(spec, law, seed=seed, options=options_of(entry))
