"""Limits and sizes: documented in docs/settings.md, set by environment variables."""

from __future__ import annotations

from pathlib import Path

import pytest

from nlosctl.contract.limits import LIMITS, SIZES, limit, limit_variable, size, size_variable
from nlosctl.errors import UsageError

DOCUMENT = Path(__file__).parents[2] / "docs" / "settings.md"


@pytest.mark.parametrize(
    ("variable", "default"),
    [
        *((limit_variable(name), known.default) for name, known in LIMITS.items()),
        *((size_variable(name), known.default) for name, known in SIZES.items()),
    ],
)
def test_limits_and_sizes_are_documented(variable: str, default: int) -> None:
    """docs/settings.md lists each limit and size with its variable and its default."""
    assert f"| `{variable}` | {default} " in DOCUMENT.read_text(encoding="utf-8")


def test_environment_variables_set_limits_and_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable sets its limit or size; an empty one leaves the default."""
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", " 12 ")
    monkeypatch.setenv("NLOSCTL_CHUNK_ROWS", "13")
    assert (limit("columns"), size("chunk_rows")) == (12, 13)
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", "")
    monkeypatch.setenv("NLOSCTL_CHUNK_ROWS", "")
    assert (limit("columns"), size("chunk_rows")) == (LIMITS["columns"].default, SIZES["chunk_rows"].default)


@pytest.mark.parametrize("text", ["many", "-1", "1e3", "9" * 30, "\u0663"])
def test_limits_and_sizes_are_integers(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A value that is not a plain integer is a usage error that names the variable."""
    for variable in ("NLOSCTL_MAX_COLUMNS", "NLOSCTL_CHUNK_ROWS"):
        monkeypatch.setenv(variable, text)
    with pytest.raises(UsageError, match="NLOSCTL_MAX_COLUMNS must be an integer of 0 or more"):
        limit("columns")
    with pytest.raises(UsageError, match="NLOSCTL_CHUNK_ROWS must be an integer of 1 or more"):
        size("chunk_rows")


def test_a_size_of_zero_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit may be 0, a size may not."""
    monkeypatch.setenv("NLOSCTL_MAX_MEMORY_MB", "0")
    monkeypatch.setenv("NLOSCTL_GROUP_ROWS", "0")
    assert limit("memory_mb") == 0
    with pytest.raises(UsageError, match="NLOSCTL_GROUP_ROWS must be an integer of 1 or more"):
        size("group_rows")
