"""The job and options of a method or scenario, parsed from its source: completion is too short to import numpy."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

__all__ = ["Glance", "glance"]

_DEPTH = 5


@dataclass(frozen=True, kw_only=True)
class Glance:
    """The job of a spec, and its options with their meanings; empty if the source does not state them literally."""

    job: str = ""
    options: tuple[tuple[str, str], ...] = ()


@cache
def glance(module: str, attribute: str) -> Glance:
    """Return the job and options of the spec that the source of ``module`` assigns to ``attribute``."""
    words = dict(_keywords(module, attribute, _DEPTH))
    job, options = words.get("job"), words.get("options")
    return Glance(
        job=str(job.value) if isinstance(job, ast.Constant) else "",
        options=tuple(_fields(module, options.id, _DEPTH)) if isinstance(options, ast.Name) else (),
    )


@cache
def _tree(module: str) -> ast.Module:
    with suppress(ImportError, AttributeError, ValueError, OSError, SyntaxError):
        found = find_spec(module)
        if found is not None and found.origin is not None:
            return ast.parse(Path(found.origin).read_text(encoding="utf-8"))
    return ast.Module(body=[], type_ignores=[])


def _keywords(module: str, attribute: str, depth: int) -> Iterator[tuple[str, ast.expr]]:
    """Yield the keywords of the call that creates the spec; for ``replace(OTHER, ...)``, those of OTHER first."""
    for statement in _tree(module).body:
        if isinstance(statement, ast.Assign) and [getattr(to, "id", "") for to in statement.targets] == [attribute]:
            call = statement.value
            if isinstance(call, ast.Call):
                if call.args and isinstance(call.args[0], ast.Name) and depth:
                    yield from _keywords(module, call.args[0].id, depth - 1)
                yield from ((word.arg, word.value) for word in call.keywords if word.arg is not None)


def _fields(module: str, name: str, depth: int) -> Iterator[tuple[str, str]]:
    """Yield the fields of an options class with their meanings, in dataclass order: those of the last base first."""
    for statement in _tree(module).body:
        if isinstance(statement, ast.ImportFrom) and statement.module and depth:
            for alias in statement.names:
                if name == (alias.asname or alias.name):
                    yield from _fields(statement.module, alias.name, depth - 1)
        if isinstance(statement, ast.ClassDef) and statement.name == name:
            for base in reversed(statement.bases):
                if isinstance(base, ast.Name) and depth:
                    yield from _fields(module, base.id, depth - 1)
            for line in statement.body:
                if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and not _is_shared(line):
                    yield line.target.id, _meaning(line.value)


def _is_shared(line: ast.AnnAssign) -> bool:
    """Whether a line declares a variable of the class, which is no field."""
    return ast.unparse(line.annotation).startswith("ClassVar")


def _meaning(value: ast.expr | None) -> str:
    words = value.keywords if isinstance(value, ast.Call) else []
    return next((str(ast.literal_eval(word.value)) for word in words if _is_meaning(word)), "")


def _is_meaning(word: ast.keyword) -> bool:
    return word.arg == "meaning" and isinstance(word.value, ast.Constant)
