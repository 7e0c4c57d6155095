"""Text of the user in pictures: names, titles and ids appear as they are, whatever their characters."""

from __future__ import annotations

from functools import cache

from nlosctl.plotting.library import FontProperties, findfont, get_font

__all__ = ["FONT", "plain", "plain_lines"]

FONT = "DejaVu Sans"
"""The font of all pictures; matplotlib contains it."""

_LONGEST = 48


def plain(text: object, longest: int = _LONGEST) -> str:
    """Return text that matplotlib shows as it is: without mathematics, hidden labels, or missing glyphs.

    A dollar is escaped, a control character or one that the font lacks becomes its escape sequence (as in Python), and
    the middle of a long text is cut.
    """
    words = "".join(_shown(character) for character in str(text))
    if len(words) > longest:
        words = f"{words[: longest // 2]}…{words[len(words) - longest // 2 + 1 :]}"
    if words.startswith("_"):
        words = f" {words}"  # a label with a leading underscore is not in the legend
    return words.replace("$", r"\$")


def plain_lines(text: str, width: int, lines: int = 3) -> str:
    """Return text in ``lines`` lines of at most ``width`` characters; what does not fit is cut from the middle."""
    words = plain(text, width * lines)
    return "\n".join(words[first : first + width] for first in range(0, len(words), width))


@cache
def _shown(character: str) -> str:
    if character.isprintable() and ord(character) in _glyphs():
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:06x}"


@cache
def _glyphs() -> frozenset[int]:
    return frozenset(get_font(findfont(FontProperties(family=[FONT]))).get_charmap())
