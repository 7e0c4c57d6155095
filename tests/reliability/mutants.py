"""Mutants: a sample of small changes of the code, each of which some test must notice. `python mutants.py --help`.

A mutant is one operator, comparison or constant changed. Each runs in a fork of this process, in which the library is
loaded already; its tests are those named in `TESTS`. What no test notices is a survivor.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import io
import json
import os
import random
import resource
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CPU_SECONDS = 150
WALL_SECONDS = 3600.0
_REWRITTEN = "ignore::pytest.PytestAssertRewriteWarning"

TESTS = {
    "geometry/angles.py": ["tests/geometry/test_angles.py"],
    "geometry/blocks.py": ["tests/geometry/test_blocks.py"],
    "geometry/circle_crossings.py": ["tests/geometry/test_circle_crossings.py"],
    "geometry/circles.py": ["tests/geometry/test_circles.py"],
    "geometry/circular_reflection.py": ["tests/geometry/test_circular_reflection.py"],
    "geometry/earth.py": ["tests/geometry/test_earth.py"],
    "geometry/ellipses.py": ["tests/geometry/test_ellipses.py"],
    "geometry/error_ellipses.py": ["tests/geometry/test_error_ellipses.py"],
    "geometry/mirrors.py": ["tests/geometry/test_mirrors.py"],
    "geometry/regions.py": ["tests/geometry/test_regions.py"],
    "geometry/roots.py": ["tests/geometry/test_roots.py"],
    "geometry/segments.py": ["tests/geometry/test_segments.py"],
    "geometry/short_arc.py": ["tests/geometry/test_circular_reflection.py"],
    "geometry/symmetric.py": ["tests/geometry/test_symmetric.py"],
    "geometry/triplets.py": ["tests/geometry/test_triplets.py"],
    "geometry/visibility.py": ["tests/geometry/test_visibility.py"],
    "methods/bearings_ls.py": [
        "tests/methods/test_bearings_exact.py",
        "tests/methods/test_bearings_statuses.py",
        "tests/methods/test_bearings_near_sensors.py",
    ],
    "methods/bearings_ml.py": [
        "tests/methods/test_bearings_with_ranges.py",
        "tests/methods/test_bearings_exact.py",
        "tests/methods/test_bearings_statuses.py",
        "tests/methods/test_bearings_near_sensors.py",
    ],
    "methods/bearings_stansfield.py": [
        "tests/methods/test_bearings_exact.py",
        "tests/methods/test_bearings_statuses.py",
        "tests/methods/test_bearings_near_sensors.py",
    ],
    "methods/bearings_ml_grid.py": ["tests/methods/test_bearings_circle.py", "tests/methods/test_bearings_exact.py"],
    "methods/bearings_stansfield_focused.py": ["tests/methods/test_bearings_circle.py"],
    "methods/bearings_mixture_ml.py": [
        "tests/methods/test_bearings_robust.py",
        "tests/methods/test_bearings_with_ranges.py",
    ],
    "methods/bearings_sequential.py": [
        "tests/methods/test_bearings_robust.py",
        "tests/methods/test_bearings_with_ranges.py",
    ],
    "methods/bearings_suppress.py": ["tests/methods/test_bearings_robust.py"],
    "methods/ranges_r_ls.py": ["tests/methods/test_ranges_localize.py"],
    "methods/ranges_sr_ls.py": ["tests/methods/test_ranges_localize.py"],
    "methods/ranges_mixture_ml.py": ["tests/methods/test_ranges_mixture.py"],
    "methods/ranges_assignment.py": ["tests/methods/test_ranges_identify.py"],
    "methods/ranges_tca.py": ["tests/methods/test_ranges_identify.py", "tests/methods/test_ranges_type_clustering.py"],
    "methods/ranges_extended_tca.py": [
        "tests/methods/test_ranges_identify.py",
        "tests/methods/test_ranges_type_clustering.py",
    ],
    "methods/triplets_chi2.py": ["tests/methods/test_triplets_detect.py"],
    "methods/triplets_joint.py": ["tests/methods/test_triplets_detect.py"],
    "methods/triplets_tdaj.py": ["tests/methods/test_triplets_detect.py"],
    "methods/triplets_ml.py": ["tests/methods/test_triplets_ml.py"],
}
"""The tests of each file. The laws of `nlosctl.testing`, which hold all methods, come on top for methods."""

_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A changed module: where, and its line before and after."""

    file: str
    line: int
    before: str
    after: str
    tree: ast.Module


def mutants_of(file: str) -> Iterator[Mutant]:
    """Yield every mutant of a module of the package."""
    text = (ROOT / "nlosctl" / file).read_text(encoding="utf-8")
    count = sum(1 for _ in _places(ast.parse(text)))
    for number in range(count):
        tree = ast.parse(text)
        node = next(place for turn, place in enumerate(_places(tree)) if turn == number)
        before = ast.unparse(node)
        _change(node)
        yield Mutant(file=file, line=node.lineno, before=before, after=ast.unparse(node), tree=tree)


def _places(tree: ast.Module) -> Iterator[ast.expr]:
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in ast.walk(ast.Module(body=function.body, type_ignores=[])):
            if (isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS and not _is_type(node)) or (
                isinstance(node, ast.Compare) and type(node.ops[0]) in _COMPARISONS
            ):
                yield node
            elif type(getattr(node, "value", None)) is float or type(getattr(node, "op", None)) in (
                ast.USub,
                ast.Invert,
            ):
                yield node  # type: ignore[misc]


def _is_type(node: ast.BinOp) -> bool:
    return isinstance(node.op, ast.BitOr) and "None" in ast.unparse(node)


def _change(node: ast.expr) -> None:
    match node:
        case ast.BinOp():
            node.op = _OPERATORS[type(node.op)]()
        case ast.Compare():
            node.ops[0] = _COMPARISONS[type(node.ops[0])]()
        case ast.Constant():
            node.value = 1.25 * float(node.value) if node.value else 1e-3  # type: ignore[arg-type]
        case ast.UnaryOp():
            node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.USub()


def is_noticed(mutant: Mutant) -> bool:
    """Run the tests of a mutant's file in a fork; whether they fail, or do not end."""
    child = os.fork()
    if child == 0:
        used = int(time.process_time())
        resource.setrlimit(resource.RLIMIT_CPU, (used + CPU_SECONDS, used + CPU_SECONDS))
        os._exit(_run(mutant))
    deadline = time.monotonic() + WALL_SECONDS
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status != 0
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def _run(mutant: Mutant) -> int:
    """Put the mutant in the place of its module, in every module that took something from it, and run its tests."""
    name = f"nlosctl.{mutant.file.removesuffix('.py').replace('/', '.')}"
    module = importlib.import_module(name)
    old = dict(vars(module))
    exec(compile(mutant.tree, str(module.__file__), "exec"), vars(module))  # noqa: S102 - our own code, changed
    new = {id(old[key]): value for key, value in vars(module).items() if key in old and not key.startswith("__")}
    own = {id(value) for value in old.values() if getattr(value, "__module__", None) == name}
    for other in list(sys.modules.values()):
        for key, value in list(getattr(other, "__dict__", {}).items()):
            if id(value) in own and id(value) in new and other is not module:
                setattr(other, key, new[id(value)])
    words = [str(ROOT / test) for test in TESTS[mutant.file]]
    if mutant.file.startswith("methods/"):
        spec = mutant.file.removeprefix("methods/").removesuffix(".py").replace("_", ".", 1).replace("_", "-")
        words += [str(ROOT / "tests/contract/test_laws.py"), "--deselect", "none"]
        words += ["-k", f"{spec} or not test_a_built_in"]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-W", _REWRITTEN, *words]))


def main() -> int:
    """Sample mutants of each file and tell which survive; exit 0 whatever is found."""
    parser = argparse.ArgumentParser(description="A sample of mutants, and which of them no test notices.")
    parser.add_argument("--each", type=int, default=10, help="mutants of each file")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--files", default="", help="only these, by the beginning of their name")
    parser.add_argument("--minutes", type=float, default=600.0)
    arguments = parser.parse_args()
    os.chdir(ROOT)
    deadline = time.monotonic() + 60.0 * arguments.minutes
    chance = random.Random(arguments.seed)  # noqa: S311 - drawn to be made again
    for package in ("nlosctl.api", "scipy.optimize", "scipy.special", "pyarrow.parquet"):
        importlib.import_module(package)
    tried = killed = 0
    for file in TESTS:
        if not file.startswith(tuple(arguments.files.split(","))):
            continue
        every = list(mutants_of(file))
        whole = ast.parse((ROOT / "nlosctl" / file).read_text(encoding="utf-8"))
        if is_noticed(Mutant(file=file, line=0, before="", after="", tree=whole)):
            sys.stdout.write(f"{file}: its tests fail without any mutant\n")
            return 1
        for mutant in chance.sample(every, min(arguments.each, len(every))):
            if time.monotonic() > deadline:
                break
            noticed = is_noticed(mutant)
            tried, killed = tried + 1, killed + noticed
            if not noticed:
                told = {"file": file, "line": mutant.line, "before": mutant.before, "after": mutant.after}
                sys.stdout.write(json.dumps(told) + "\n")
                sys.stdout.flush()
        sys.stdout.write(json.dumps({"after": file, "of": len(every), "tried": tried, "killed": killed}) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
