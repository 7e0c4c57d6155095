"""The tutorials: every command runs as it stands, the figures told hold, and the pictures shown are made by them."""

from __future__ import annotations

from pathlib import Path

import pytest
from build_pictures import PICTURES, pages, pictures_of
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
    for picture in pictures_of(ROOT / name):
        assert (tmp_path / picture).stat().st_size > 10_000


@pytest.mark.parametrize("name", pages())
def test_every_picture_is_there(name: str) -> None:
    """What a page shows is in the repository, and made by a command on that page."""
    commands = "\n".join(read_page(name).commands)
    for picture in pictures_of(ROOT / name):
        assert (PICTURES / picture).is_file(), "run 'make pictures'"
        assert f"-o {picture}" in commands


def test_every_picture_is_shown() -> None:
    """No picture is left over."""
    shown = {picture for name in pages() for picture in pictures_of(ROOT / name)}
    assert {path.name for path in PICTURES.iterdir()} == shown


def test_there_are_the_four_tutorials() -> None:
    """Direction finding, indoor UWB, over the horizon, channel sounder: each with a picture."""
    assert [Path(name).stem for name in TUTORIALS] == [
        "channel-sounder", "direction-finding", "indoor-uwb", "over-the-horizon"
    ]  # fmt: skip
    assert [name for name in TUTORIALS if not pictures_of(ROOT / name)] == []
