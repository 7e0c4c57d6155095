"""CONTRIBUTING.md: the blocks of each recipe run, in order, on a copy of the tree."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from doc_pages import ROOT, run_shell
from plugin_environment import make_environment

pytestmark = pytest.mark.process

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL))
ACTIVATE = ". .venv/bin/activate\n"


def blocks(text: str) -> list[str]:
    """The shell blocks of a text."""
    return re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def copy_tree(folder: Path) -> Path:
    """Copy the files of the repository, without what git ignores, and make the environment of the recipes there."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True)
    for name in listed.stdout.decode().splitlines():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    make_environment(folder / ".venv", source=folder)
    return folder


def test_every_recipe_has_its_section() -> None:
    """The page has the recipes, and begins with the block that activates the environment."""
    titles = {"A method", "An importer", "A result column", "A command", "A figure of a paper"}
    assert set(SECTIONS) == titles
    assert blocks(TEXT)[0] == ACTIVATE


@pytest.mark.parametrize("title", SECTIONS)
def test_a_recipe_works_to_the_letter(title: str, tmp_path: Path) -> None:
    """All blocks of a recipe succeed on a copy of the tree, each as it stands."""
    folder = copy_tree(tmp_path / "clone")
    done = run_shell("\n".join([ACTIVATE, *blocks(SECTIONS[title])]), folder)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
