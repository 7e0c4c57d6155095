"""Corrupt the bytes of a file: bit flips, cuts, splices, extreme integers, and unusual words."""

from __future__ import annotations

import gzip
import random
import re
import struct
from collections.abc import Callable, Sequence

__all__ = ["corrupt"]

_INTEGERS = (0, 1, -1, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1, 2**62, 2**63 - 1, -(2**63))

_WORDS = [
    b"", b"0", b"-0", b"-1", b"1", b"nan", b"NaN", b"inf", b"-inf", b"1e308", b"1e309", b"-1e308", b"1e-320",
    b"5e-324",
    b"9223372036854775807", b"9223372036854775808", b"18446744073709551616", b"1_000", b"0x10", b"1,5",
    b"1.5.2", b" 3 ",    b"+7", b"007", b"true", b"false", b"TRUE", b"null", b"None", b"[]", b"{}", b'""',
    b'"', b"'", b"\\",
    b"\0", b"\x1b[31m",    b"\x07", b"\xff\xfe", b"\xc3\x28",
    b"\xed\xa0\x80", "\u202e".encode(), "\u2028".encode(), "\u0665".encode(),
    b"\r", b"\n", b"\r\n", b"\t", b";", b",", b",,,,", b"=1+1", b"#", b"1e5", b"100000", b"1e16", b"roof", b"a" * 500,
    b"[" * 300, b'{"a":' * 300, b"9" * 5000, b"\\ud800", b"-", b".", b"e", b"../../x", b"%s%n", b"[[sensor]]",
]  # fmt: skip
"""Replacements of a word of a text file."""


def corrupt(content: bytes, others: Sequence[bytes], *, text: bool, zipped: bool, chance: random.Random) -> bytes:
    """Return ``content`` corrupted in one to four ways; gzipped text is mostly corrupted before compression."""
    if zipped and chance.random() < 0.6:
        return gzip.compress(_corrupt(gzip.decompress(content), [], True, chance), mtime=0)
    return _corrupt(content, others, text and not zipped, chance)


def _corrupt(content: bytes, others: Sequence[bytes], text: bool, chance: random.Random) -> bytes:
    ways = [*_BYTE_WAYS, *_TEXT_WAYS * 4] if text else _BYTE_WAYS
    for _ in range(chance.choice((1, 1, 1, 2, 3, 4))):
        if others and chance.random() < 0.05:
            content = _spliced(content, chance.choice(others), chance)
        elif content:
            content = chance.choice(ways)(content, chance)
    return content


def _flip_bits(content: bytes, chance: random.Random) -> bytes:
    corrupted = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8))):
        corrupted[chance.randrange(len(corrupted))] ^= 1 << chance.randrange(8)
    return bytes(corrupted)


def _flip_near_an_end(content: bytes, chance: random.Random) -> bytes:
    """Flip bits near the ends, where headers and footers are."""
    corrupted, reach = bytearray(content), min(len(content), 400)
    position = chance.randrange(reach)
    corrupted[position if chance.random() < 0.3 else -1 - position] = chance.randrange(256)
    return bytes(corrupted)


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content))]


def _take_out(content: bytes, chance: random.Random) -> bytes:
    start = chance.randrange(len(content))
    return content[:start] + content[start + chance.choice((1, 2, 8, 64, 512)) :]


def _repeat(content: bytes, chance: random.Random) -> bytes:
    start = chance.randrange(len(content))
    stop = start + chance.choice((1, 4, 16, 256))
    return content[:stop] + content[start:stop] * chance.choice((1, 1, 3, 20)) + content[stop:]


def _set_integer(content: bytes, chance: random.Random) -> bytes:
    size, form = chance.choice(((1, "b"), (2, "<h"), (4, "<i"), (8, "<q")))
    bits = 8 * size
    value = (chance.choice(_INTEGERS) + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))
    position = chance.randrange(len(content))
    return content[:position] + struct.pack(form, value) + content[position + size :]


def _zero(content: bytes, chance: random.Random) -> bytes:
    start, size = chance.randrange(len(content)), chance.choice((4, 16, 64))
    return content[:start] + bytes(size) + content[start + size :]


def _spliced(content: bytes, other: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content) + 1)] + other[chance.randrange(len(other) + 1) :]


def _set_word(content: bytes, chance: random.Random) -> bytes:
    """Replace a cell, a value or a key by an unusual word."""
    words = list(re.finditer(rb"[^,\s\"{}\[\]:=]+", content))
    if not words:
        return content
    word = chance.choice(words)
    return content[: word.start()] + chance.choice(_WORDS) + content[word.end() :]


def _change_digit(content: bytes, chance: random.Random) -> bytes:
    """Replace a digit by another: mostly the file stays valid."""
    positions = [match.start() for match in re.finditer(rb"\d", content)]
    if not positions:
        return content
    position = chance.choice(positions)
    return content[:position] + str(chance.randrange(10)).encode() + content[position + 1 :]


def _insert_word(content: bytes, chance: random.Random) -> bytes:
    position = chance.randrange(len(content) + 1)
    return content[:position] + chance.choice(_WORDS) + content[position:]


def _move_line(content: bytes, chance: random.Random) -> bytes:
    """Remove a line and insert it elsewhere once, twice or not at all."""
    lines = content.splitlines(keepends=True)
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 1, 1, 2))):
        lines.insert(chance.randrange(len(lines) + 1), line)
    return b"".join(lines)


def _set_column(content: bytes, chance: random.Random) -> bytes:
    """Put an unusual word in the same cell of every line."""
    lines = content.splitlines(keepends=True)
    position, word = chance.randrange(8), chance.choice(_WORDS)
    for number, line in enumerate(lines[1:], start=1):
        cells = line.split(b",")
        if position < len(cells) - 1:
            cells[position] = word
            lines[number] = b",".join(cells)
    return b"".join(lines)


_BYTE_WAYS: list[Callable[[bytes, random.Random], bytes]] = [
    _flip_bits,
    _flip_bits,
    _flip_near_an_end,
    _cut,
    _take_out,
    _repeat,
    _set_integer,
    _set_integer,
    _zero,
]
_TEXT_WAYS: list[Callable[[bytes, random.Random], bytes]] = [
    _set_word,
    _set_word,
    _change_digit,
    _change_digit,
    _insert_word,
    _move_line,
    _set_column,
]
