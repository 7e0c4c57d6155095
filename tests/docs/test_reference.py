"""The command reference and the man page agree with the program."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import typer.main
from build_reference import REFERENCES

from nlosctl.cli.main import app

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
MARKDOWN = ROOT / "docs" / "commands.md"
MANUAL = ROOT / "man" / "nlosctl.1"


@pytest.mark.parametrize("path", [MARKDOWN, MANUAL], ids=lambda path: path.name)
def test_the_reference_is_fresh(path: Path) -> None:
    """The file equals the output of ``make reference``."""
    assert path.read_text(encoding="utf-8") == REFERENCES[path](), "run 'make reference'"


def leaves(command: Any = None, name: str = "nlosctl") -> dict[str, Any]:
    """Every command that can be run, by its full name."""
    command = typer.main.get_command(app) if command is None else command
    runnable = {} if hasattr(command, "commands") and not command.params else {name: command}
    for word, inner in getattr(command, "commands", {}).items():
        runnable.update(leaves(inner, f"{name} {word}"))
    return runnable


@pytest.mark.parametrize("name", leaves())
def test_every_option_is_in_the_reference(name: str) -> None:
    """The section of a command has every spelling and the help of every option, in Markdown and in the man page."""
    page = re.search(rf"^## {name}\n(.*?)(?=^## |\Z)", MARKDOWN.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    plain = re.sub(r"\\f[BIR]|\\&", "", MANUAL.read_text(encoding="utf-8"))
    plain = plain.replace("\\-", "-").replace("\\(aq", "'").replace("\\(ga", "`").replace("\\e", "\\")
    manual = re.search(rf"^\.SS {name} \[OPTIONS\].*?(?=^\.S[SH] |\Z)", plain, re.MULTILINE | re.DOTALL)
    assert page is not None
    assert manual is not None
    for option in leaves()[name].params:
        for word in (*option.opts, *option.secondary_opts) if option.opts[0].startswith("-") else ():
            assert f"`{word}`" in page[1]
            assert re.search(rf"^(.*, )?{word}(,| |$)", manual[0], re.MULTILINE)
        assert " ".join(option.help.split()) in page[1].replace("\\|", "|")


@pytest.mark.process
def test_troff_has_no_warning() -> None:
    """groff formats the man page without a warning."""
    if shutil.which("groff") is None:
        pytest.skip("no groff on this machine")
    done = subprocess.run(["groff", "-man", "-ww", "-z", str(MANUAL)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_man_page_is_installed() -> None:
    """The wheel installs the man page where ``man`` searches."""
    assert '"man/nlosctl.1" = "share/man/man1/nlosctl.1"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
