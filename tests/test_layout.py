"""Sizes of rooms, and the modules that a row of measurements passes on its way to an estimate."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from program import run_here

PACKAGE = Path(__file__).parents[1] / "nlosctl"
ONE_FILE_PER_ENTRY = {"methods", "formats", "scenarios", "tables"}
"""Rooms with one file per plugin or table, of any number."""

TRACE = """
import json, sys
from importlib.metadata import entry_points

entered, imports = set(), 0

def trace(frame, event, argument):
    global imports
    code = frame.f_code
    if code.co_name == "<module>":
        imports += (event == "call") - (event == "return")
    elif event == "call" and not imports and code.co_flags & 1 and code.co_name != "<lambda>":
        entered.add(frame.f_globals.get("__name__", ""))

program = next(point for point in entry_points(group="console_scripts") if point.name == "nlosctl").load()
sys.setprofile(trace)
try:
    program()
except SystemExit:
    pass
finally:
    sys.setprofile(None)
print(json.dumps(sorted(name for name in entered if name.startswith("nlosctl"))))
"""
"""Runs the program and prints the modules whose functions are called, other than while modules are imported."""


def test_scripts_import_what_exists() -> None:
    """Every name of nlosctl that benchmarks and builders import exists; mypy does not check them."""
    root = PACKAGE.parent
    scripts = [
        path for folder in ("benchmarks", "docs/builders", "fixtures/builders") for path in root.glob(f"{folder}/*.py")
    ]
    missing = []
    for path in scripts:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("nlosctl"):
                missing += [
                    f"{path.name}: {node.module}.{name.name}"
                    for name in node.names
                    if not exists(node.module, name.name)
                ]
    assert scripts
    assert missing == []


def exists(module: str | None, name: str) -> bool:
    """Whether a module has a name, or a submodule of that name."""
    try:
        return hasattr(importlib.import_module(str(module)), name) or bool(importlib.util.find_spec(f"{module}.{name}"))
    except ImportError:
        return False


def test_rooms_have_at_most_20_modules() -> None:
    """A room of more than 20 modules is divided, except for those with one file per plugin or table."""
    counts = Counter(path.parent for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")
    large = {str(room.relative_to(PACKAGE)): count for room, count in counts.items() if count > 20}
    assert {room: count for room, count in large.items() if Path(room).name not in ONE_FILE_PER_ENTRY} == {}


def test_no_module_is_above_300_lines() -> None:
    """A module of more than 300 lines is divided."""
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in PACKAGE.rglob("*.py")}
    assert {str(path.relative_to(PACKAGE)): count for path, count in lines.items() if count > 300} == {}


@pytest.mark.process
@pytest.mark.parametrize(("extension", "most"), [("parquet", 48), ("csv", 50)])
def test_a_row_passes_few_modules(tmp_path: Path, extension: str, most: int) -> None:
    """``localize`` by a closed form, in one process, calls functions of at most 48 modules (50 for CSV)."""
    assert run_here("simulate", "ring", "-n", "50", "-q", "-o", f"in.{extension}", folder=tmp_path).returncode == 0
    words = ["localize", "-m", "stansfield", f"in.{extension}", "-o", "out.parquet", "--jobs", "1", "-q"]
    command = [sys.executable, "-c", TRACE, *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    modules = json.loads(done.stdout)
    assert (tmp_path / "out.parquet").exists()
    assert len(modules) <= most, modules
