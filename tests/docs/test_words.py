"""Habits of language that stay out of the pages and of the package, each with what to write in its place.

``CLEAN`` lists the paths without these habits; add a path as soon as it has none. ``LEFT_OUT`` are pages generated from
the package, and this file.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LEFT_OUT = ("docs/papers.md", "tests/docs/test_words.py")
CLEAN = (
    *(
        "README.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "docs",
        "benchmarks",
        "fixtures/builders",
        "nlosctl",
    ),
    "tests",
)
# Pattern (any case, except within (?-i:...)): what to write instead.
HABITS = {
    r"\b(tells?|told|telling)\b": "report, print, state, specify, name, record, contain, distinguish",
    r"\bsaid\b": "reported, stated, printed",
    r"\bnought\b": "zero",
    r"\banew\b": "again",
    r"\bbut for\b": "except for, apart from",
    r"\bof which\b": "whose, some of them",
    r"(?-i:\b(is|are) none\b)": "is not a ..., does not exist",
    r"(?<!there )\b(is|are) no (file|number|table|status|list|array|sentence|answer|TOML|UTF-8)\b": "is not a ...",
    r"\bunless (told|given)\b": "default: ...",
    r"\bspoilt\b": "corrupted, damaged",
    r"\bforet(ell|old|ells|elling)\b": "predict",
    r"\b(hold|held|holds)\b[^.]{0,40}\bagainst\b": "compare ... with",
    r"words of the command": "usage error, arguments",
    r"\b(stand|stands|fall|falls) (or fall|or falls|together)\b": "all-or-nothing",
    r"\bin the making\b": "temporary, unfinished",
    r"\bbeyond reason\b": "too large, too deep",
    r"\b(lest|whence|thereof|whereupon)\b": "so that ... not, from which",
    r"\bgive or take\b": "within",
    r"\bthe machine gives\b": "available CPUs",
    r"\bwho does the work\b": "execution engine",
    r"\bgo(es)? on\b": "continue, resume",
    r"\bstands? in for\b": "replaces",
}


def scanned(entry: str) -> list[Path]:
    """The text files of an entry of ``CLEAN``: itself, or those in its folder."""
    path = ROOT / entry
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.suffix in (".py", ".md"))
    return [file for file in files if file.relative_to(ROOT).as_posix() not in LEFT_OUT]


@pytest.mark.parametrize("entry", CLEAN)
def test_no_habit_comes_back(entry: str) -> None:
    """No line of a clean path has a habit; a complaint names file and line, and what to write."""
    complaints = [
        f"{file.relative_to(ROOT)}:{number}: {match[0]!r}: write {better!r}"
        for file in scanned(entry)
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        for pattern, better in HABITS.items()
        if (match := re.search(pattern, line, re.IGNORECASE))
    ]
    assert complaints == [], "\n" + "\n".join(complaints)


def test_every_clean_path_exists() -> None:
    """Every entry of ``CLEAN`` has files to scan, so that a renamed folder is not left unscanned."""
    assert [entry for entry in CLEAN if not scanned(entry)] == []


@pytest.mark.parametrize(
    "line",
    ["It tells all.", "0.25 unless told", "begin anew", "rows, two of which", "the name is none", "A is no file"],
)
def test_a_habit_is_noticed(line: str) -> None:
    """The patterns can fail: each of these lines has a habit."""
    assert any(re.search(pattern, line, re.IGNORECASE) for pattern in HABITS)
