"""docs/writing-a-method.md followed to the letter: from an empty folder to a method that obeys the laws."""

from __future__ import annotations

import re
import site
import sys
import venv
from pathlib import Path

import pytest
from doc_pages import ROOT, read_page, run_shell

PAGE = read_page("docs/writing-a-method.md")
PIP = '#!/bin/sh\nexec "{python}" -m pip --disable-pip-version-check "$@" --no-index --no-deps --no-build-isolation\n'
NLOSCTL = '#!/bin/sh\nexec "{python}" -W error -m nlosctl.cli "$@"\n'
PYTEST = '#!/bin/sh\nexec "{python}" -m pytest -p no:cacheprovider -W error "$@"\n'


def make_environment(folder: Path) -> None:
    """Make the virtual environment of the page: with what is installed here in place of what pip would fetch.

    It is fresh: the plugin goes into it, and not into the environment of these tests.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next((folder / "lib").glob("python*")) / "site-packages"
    here = [path for path in sys.path if path.endswith("-packages")] + site.getsitepackages()
    lines = [f"import site; site.addsitedir({path!r})" for path in dict.fromkeys(here)]
    (packages / "here.pth").write_text("\n".join(lines) + "\n")
    for name, text in (("pip", PIP), ("nlosctl", NLOSCTL), ("pytest", PYTEST)):
        (folder / "bin" / name).write_text(text.format(python=folder / "bin" / "python"))
        (folder / "bin" / name).chmod(0o755)


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the commands of the page print, one after the other, in a folder with the files of the page."""
    folder = tmp_path_factory.mktemp("plugin")
    PAGE.write(folder)
    (script,) = PAGE.commands
    first, rest = script.split("\n", 1)
    assert first == "python -m venv .venv"
    make_environment(folder / ".venv")
    done = run_shell(rest, folder)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_the_page_is_one_file_and_one_stanza() -> None:
    """Besides the test of its laws, a plugin is a Python file and a pyproject.toml."""
    assert set(PAGE.files) == {"pyproject.toml", "nlosctl_weighted_lines.py", "test_weighted_lines.py"}


def test_the_plugin_is_listed(said: str) -> None:
    """``nlosctl methods`` lists it with its distribution, and ``--check`` loads it, without harming another."""
    assert re.search(r"^bearings +weighted-lines +nlosctl-weighted-lines +0\.1 *$", said, re.MULTILINE)
    assert re.search(r"^bearings +weighted-lines +nlosctl-weighted-lines +0\.1 +ok *$", said, re.MULTILINE)
    assert re.search(r"^bearings +ml +nlosctl +\S+ +ok *$", said, re.MULTILINE)


def test_the_plugin_obeys_the_laws(said: str) -> None:
    """The page's own test, of every law, passes."""
    from nlosctl.testing import LAWS

    assert f"{len(LAWS)} passed" in said


def test_the_plugin_is_evaluated_beside_the_others(said: str) -> None:
    """The last command compares it with the built-in methods."""
    assert re.findall(r"^estimates,([\w-]+),1000,", said, re.MULTILINE) == ["weighted-lines", "stansfield", "ml"]


def test_the_page_tells_the_contract_version() -> None:
    """The version that the template states, and the page tells, is the current one."""
    from nlosctl.contract.methods import CONTRACT_VERSION

    assert f"contract_version={CONTRACT_VERSION}," in PAGE.files["nlosctl_weighted_lines.py"]
    assert f"It is {CONTRACT_VERSION}." in (ROOT / PAGE.name).read_text(encoding="utf-8")
