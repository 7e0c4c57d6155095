"""docs/writing-a-method.md: its files and commands lead from an empty folder to a method that obeys the laws."""

from __future__ import annotations

import re

import pytest
from doc_pages import ROOT, read_page, run_shell
from plugin_environment import make_environment

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("writing_a_method")]

PAGE = read_page("docs/writing-a-method.md")


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Standard output of the commands of the page, in order, in a folder with the files of the page."""
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
    """A plugin is a Python file and a pyproject.toml, with a test of the laws."""
    assert set(PAGE.files) == {"pyproject.toml", "nlosctl_weighted_lines.py", "test_weighted_lines.py"}


def test_the_plugin_is_listed(output: str) -> None:
    """``nlosctl methods`` lists the plugin with its distribution; ``--check`` loads it and the built-in methods."""
    assert re.search(r"^bearings +weighted-lines +nlosctl-weighted-lines +0\.1 *$", output, re.MULTILINE)
    assert re.search(r"^bearings +weighted-lines +nlosctl-weighted-lines +0\.1 +ok *$", output, re.MULTILINE)
    assert re.search(r"^bearings +ml +nlosctl +\S+ +ok *$", output, re.MULTILINE)


def test_the_plugin_obeys_the_laws(output: str) -> None:
    """The test of the page passes for every law."""
    from nlosctl.testing import LAWS

    assert f"{len(LAWS)} passed" in output


def test_the_plugin_is_evaluated_beside_the_others(output: str) -> None:
    """The last command compares the plugin with built-in methods."""
    assert re.findall(r"^estimates,([\w-]+),1000,", output, re.MULTILINE) == ["weighted-lines", "stansfield", "ml"]


def test_the_page_states_the_contract_version() -> None:
    """The template and the text of the page state the current version."""
    from nlosctl.contract.methods import CONTRACT_VERSION

    assert f"contract_version={CONTRACT_VERSION}," in PAGE.files["nlosctl_weighted_lines.py"]
    assert f"It is {CONTRACT_VERSION}." in (ROOT / PAGE.name).read_text(encoding="utf-8")
