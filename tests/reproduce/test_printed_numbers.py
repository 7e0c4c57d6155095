"""What the papers print, copied into a list of its own."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from nlosctl.reproduce.catalogue import experiment_names, find_experiment

PRINTED = Path(__file__).with_name("printed_numbers.csv")


def listed(name: str) -> list[tuple[str, str, str]]:
    """Return place, words or number of the paper, and allowed range of the claims of an experiment in the list."""
    with PRINTED.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [(row["where"], row["paper"], row["allowed"]) for row in rows if row["experiment"] == name]


@pytest.mark.parametrize("name", experiment_names())
def test_the_claims_have_the_numbers_of_the_paper(name: str) -> None:
    """A number of a paper, its place and the range that confirms it are in printed_numbers.csv too."""
    claims = find_experiment(name).claims
    ours = [
        (claim.where, claim.expected.text, claim.expected.allowed) if claim.expected else (claim.where, "", "")
        for claim in claims
    ]
    assert ours == listed(name)
