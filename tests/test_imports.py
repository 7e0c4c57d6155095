"""Directions of imports, and modules without heavy libraries."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted((ROOT / "nlosctl").rglob("*.py"))


@pytest.mark.process
def test_the_import_contract_is_kept() -> None:
    """The contracts of pyproject.toml hold: layers, independent methods, use of pyarrow."""
    program = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([program, "--no-cache"], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stdout
    assert "0 broken" in done.stdout


@pytest.mark.process
@pytest.mark.parametrize(
    "module",
    ["errors", "version", "contract.tables", "contract.statuses", "registry", "scenarios.catalogue", "cli.main"],
)
def test_light_modules_import_no_arrays(module: str) -> None:
    """Modules needed for help, completion and lists import neither numpy nor pyarrow nor scipy."""
    program = f"import sys, nlosctl.{module}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & {"numpy", "scipy", "pyarrow", "msgspec"} == set()


def is_for_types_only(node: ast.AST) -> bool:
    """Whether a node is an ``if TYPE_CHECKING``, whose imports never run."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def imported(path: Path) -> frozenset[str]:
    """Return the top-level modules that a file imports anywhere, except for types only."""
    found: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    tree.body = [node for node in tree.body if not is_for_types_only(node)]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return frozenset(found)


def importers(name: str) -> set[str]:
    """Return the rooms of the package with a file that imports ``name``."""
    return {path.relative_to(ROOT / "nlosctl").parts[0] for path in MODULES if name in imported(path)}


def test_each_library_has_its_room() -> None:
    """pyarrow is used in io and formats only, typer in the command line, matplotlib in plotting."""
    assert importers("pyarrow") <= {"io", "formats"}
    assert importers("typer") == {"cli"}
    assert importers("rich") <= {"cli"}
    assert importers("pyproj") == {"geometry"}
    assert {path.name for path in MODULES if "matplotlib" in imported(path)} <= {"library.py"}
    assert importers("matplotlib") == {"plotting"}


def test_imported_libraries_are_declared() -> None:
    """Every imported library is a dependency in pyproject.toml."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {requirement.partition(">")[0].strip() for requirement in project["dependencies"]}
    extras = {
        requirement.partition(">")[0].strip()
        for name, requirements in project["optional-dependencies"].items()
        for requirement in requirements
        if name != "dev"
    }
    used = set().union(*(imported(path) for path in MODULES)) - set(sys.stdlib_module_names) - {"nlosctl"}
    assert used <= declared | extras
    assert declared <= used


def test_errors_import_the_standard_library_only() -> None:
    """The module of errors imports the standard library only."""
    assert imported(ROOT / "nlosctl" / "errors.py") <= set(sys.stdlib_module_names)
