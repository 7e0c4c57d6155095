"""Numbers in the text of parameters."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from nlosctl.contract.options import option, parse_options
from nlosctl.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """A number, two numbers and an optional one."""

    share: float = option(0.5, meaning="a share", minimum=0.0, maximum=1.0)
    pair: tuple[float, float] = option((0.0, 1.0), meaning="two numbers")
    limit: float | None = option(None, meaning="a number, or none")


@pytest.mark.parametrize(("text", "value"), [(".1", 0.1), ("1.", 1.0), ("+0.1", 0.1), (" .5e0 ", 0.5), ("0.25", 0.25)])
def test_short_numbers_are_numbers(text: str, value: float) -> None:
    """Numbers that Python and most programs read are accepted, in pairs and optional values too."""
    options = parse_options(Numbers, {"share": text, "pair": f"{text},-{text.strip(' +')}", "limit": text}, "it")
    assert (options.share, options.pair, options.limit) == (value, (value, -value), value)


@pytest.mark.parametrize("text", [".", "1_0", "0x1", "1.2.3", "--1", "one", ""])
def test_other_texts_are_not(text: str) -> None:
    """Text that is not a number is a usage error that contains it."""
    with pytest.raises(UsageError, match="must be a float"):
        parse_options(Numbers, {"share": text}, "it")
