"""The limits of what a file may ask: told in the documents, set by the environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from nlosctl.contract.limits import LIMITS, limit, limit_variable
from nlosctl.errors import UsageError

DOCUMENT = Path(__file__).parents[2] / "docs" / "settings.md"


@pytest.mark.parametrize("name", LIMITS)
def test_every_limit_is_told(name: str) -> None:
    """docs/settings.md has each limit with its variable and its default."""
    row = f"| `{limit_variable(name)}` | {LIMITS[name].default} "
    assert row in DOCUMENT.read_text(encoding="utf-8")


def test_the_environment_sets_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable raises or lowers its limit; an empty one says nothing."""
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", " 12 ")
    assert limit("columns") == 12
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", "")
    assert limit("columns") == LIMITS["columns"].default


@pytest.mark.parametrize("text", ["many", "-1", "1e3", "9" * 30, "\u0663"])
def test_a_limit_is_a_plain_integer(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anything else is a fault of the words, with what came."""
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", text)
    with pytest.raises(UsageError, match="NLOSCTL_MAX_COLUMNS must be an integer of 0 or more"):
        limit("columns")
