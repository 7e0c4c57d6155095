"""Convention 9: help, completion and the list of methods start without heavy libraries."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cli_support import PROGRAM, plain_environment

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("lazy_imports")]

HEAVY = {"numpy", "scipy", "pyarrow", "msgspec", "pandas", "matplotlib"}

LIST = """
import contextlib, io, json, sys
from nlosctl.cli.main import run
output = io.StringIO()
with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
    run(sys.argv[1:])
print(json.dumps([sorted({name.partition(".")[0] for name in sys.modules}), output.getvalue()]))
"""

CASES: dict[str, tuple[list[str], dict[str, str], str]] = {
    "help": (["--help"], {}, "localize"),
    "version": (["--version"], {}, "nlosctl"),
    "methods": (["methods"], {}, "stansfield"),
    "methods as json": (["methods", "--json"], {}, '"stansfield"'),
    "help of localize": (["localize", "--help"], {}, "--flags-out"),
    "help of evaluate": (["evaluate", "--help"], {}, "--fail-if"),
    "schema": (["schema", "bearings"], {}, "bearing_rad"),
    "completion of commands": (
        [],
        {"_NLOSCTL_COMPLETE": "complete_bash", "COMP_WORDS": "nlosctl loc", "COMP_CWORD": "1"},
        "localize",
    ),
    "completion of options": (
        [],
        {"_NLOSCTL_COMPLETE": "complete_bash", "COMP_WORDS": "nlosctl localize --fla", "COMP_CWORD": "2"},
        "--flags-out",
    ),
    "completion in zsh": ([], {"_NLOSCTL_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": "nlosctl eva"}, "evaluate"),
}


def modules(words: list[str], environment: dict[str, str]) -> tuple[set[str], str]:
    """Return the top-level modules imported by a run of the program, and its output."""
    done = subprocess.run(
        [sys.executable, "-c", LIST, *words],
        capture_output=True,
        text=True,
        check=True,
        env=plain_environment(**environment),
    )
    names, output = json.loads(done.stdout)
    return set(names), output


@pytest.fixture(scope="module")
def imported() -> dict[str, tuple[set[str], str]]:
    """Imports and output of each case."""
    with ThreadPoolExecutor(2) as pool:
        futures = {case: pool.submit(modules, words, variables) for case, (words, variables, _) in CASES.items()}
        return {case: future.result() for case, future in futures.items()}


@pytest.mark.parametrize("case", CASES)
def test_nothing_heavy_is_imported(imported: dict[str, tuple[set[str], str]], case: str) -> None:
    """The run works, and imports neither numpy nor scipy, pyarrow or msgspec."""
    names, output = imported[case]
    assert CASES[case][2] in output
    assert names & HEAVY == set()


def test_one_process_runs_the_cases(request: pytest.FixtureRequest) -> None:
    """Tests that share a costly fixture stay together: pytest-xdist adds the group to the names of its tests."""
    if getattr(request.config.option, "loadgroup", False):
        assert request.node.nodeid.endswith("@lazy_imports")


def test_heavy_imports_are_detected() -> None:
    """A command that needs arrays imports numpy."""
    names, output = modules(["simulate", "ring", "--show"], {})
    assert "sensors" in output
    assert "numpy" in names


def test_importing_the_package_is_light() -> None:
    """``import nlosctl`` imports nothing heavy until a function is used."""
    program = "import sys, nlosctl; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & HEAVY == set()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_is_there(tmp_path: Path, shell: str) -> None:
    """``--show-completion`` prints a script that calls the program."""
    done = subprocess.run(
        [str(PROGRAM), "--show-completion", shell],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=plain_environment(_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1"),
    )
    assert done.returncode == 0, done.stderr
    assert "_NLOSCTL_COMPLETE" in done.stdout
