"""The chosen mutants of `chosen_mutants.py` apply to the code as it is."""

from __future__ import annotations

import pytest
from chosen_mutants import MUTANTS, ROOT, Mutant


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_each_chosen_mutant_applies(mutant: Mutant) -> None:
    """The text that a mutant replaces is in its module exactly once."""
    assert (ROOT / "nlosctl" / mutant.module).read_text(encoding="utf-8").count(mutant.text) == 1
