"""The tutorials: every command runs as it stands, the figures told hold, and the pictures shown are made by them."""

from __future__ import annotations

from pathlib import Path

import pytest
from build_figures import FIGURES, made_on, pages, shown_on
from doc_pages import ROOT, read_page, run_shell

TUTORIALS = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs" / "tutorials").glob("*.md"))]


@pytest.mark.parametrize("name", [*TUTORIALS, "docs/choosing-a-method.md"])
def test_a_tutorial_does_what_it_says(tmp_path: Path, name: str) -> None:
    """From an empty folder: the page's files, then its commands, of which ``--fail-if`` holds the figures it tells."""
    page = read_page(name)
    page.write(tmp_path)
    done = run_shell("\n".join(page.commands), tmp_path)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert any("--fail-if" in command for command in page.commands)
    for figure in made_on(name):
        assert (tmp_path / figure).stat().st_size > 10_000


@pytest.mark.parametrize("name", pages())
def test_every_figure_is_there(name: str) -> None:
    """What a page shows is in the repository; a tutorial's is made by a command on that page."""
    for figure in shown_on(name):
        assert (FIGURES / figure).is_file(), "run 'make figures'"
    if name in TUTORIALS:
        assert made_on(name) == shown_on(name)


def test_every_figure_is_shown() -> None:
    """No figure is left over."""
    assert {path.name for path in FIGURES.iterdir()} == {figure for name in pages() for figure in shown_on(name)}


def test_there_are_the_four_tutorials() -> None:
    """Direction finding, indoor UWB, over the horizon, channel sounder: each with a picture."""
    assert [Path(name).stem for name in TUTORIALS] == [
        "channel-sounder", "direction-finding", "indoor-uwb", "over-the-horizon"
    ]  # fmt: skip
    assert [name for name in TUTORIALS if not made_on(name)] == []
