"""Pages whose commands run from an empty folder: figures stated on them are right, pictures shown are made by them."""

from __future__ import annotations

from pathlib import Path

import pytest
from build_figures import FIGURES, made_on, pages, shown_on
from doc_pages import ROOT, Page, read_page, run_shell
from warm_program import warm_path

pytestmark = pytest.mark.process

TUTORIALS = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
TRADES = [
    path.relative_to(ROOT / "docs").with_suffix("").as_posix()
    for path in sorted((ROOT / "docs" / "trades").glob("*.md"))
]
EXAMPLES = [
    *TRADES,
    "arrivals",
    "calibration",
    "columns",
    "conventions",
    "earth",
    "echoes",
    "moving-sources",
    "outliers",
    "over-the-horizon",
    "plotting",
    "report",
    "settings",
    "several-sources",
    "three-dimensions",
    "tracks",
    "uncertain-geometry",
    "unknown-std",
    "windows",
]


def run_page(name: str, folder: Path) -> Page:
    """Write the files of a page and run its commands; they must succeed."""
    page = read_page(name)
    page.write(folder)
    done = run_shell("\n".join(page.commands), folder, PATH=warm_path())
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return page


@pytest.mark.parametrize("name", [*TUTORIALS, "docs/choosing-a-method.md"])
def test_a_tutorial_keeps_its_figures(tmp_path: Path, name: str) -> None:
    """A tutorial runs; ``--fail-if`` checks the figures that its text states, and its pictures are made."""
    page = run_page(name, tmp_path)
    assert any("--fail-if" in command for command in page.commands)
    for figure in made_on(name):
        assert (tmp_path / figure).stat().st_size > 10_000


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_a_page_run(tmp_path: Path, name: str) -> None:
    """The commands of a page run in order, each as it stands."""
    assert run_page(f"docs/{name}.md", tmp_path).commands


@pytest.mark.parametrize("name", pages())
def test_every_figure_exists(name: str) -> None:
    """The figures of a page are in the repository; a command of a tutorial makes each of its own."""
    for figure in shown_on(name):
        assert (FIGURES / figure).is_file(), "run 'make figures'"
    if name in TUTORIALS:
        assert made_on(name) == shown_on(name)


def test_every_figure_is_shown() -> None:
    """Each figure in the repository is shown on a page."""
    assert {path.name for path in FIGURES.iterdir()} == {figure for name in pages() for figure in shown_on(name)}


WITHOUT_PICTURE = {
    "a-ship-that-listens",
    "a-walk-indoors",
    "an-aircraft-and-its-altitude",
    "anchors-on-a-ceiling",
    "arrays-in-space",
    "microphones-around-a-meadow",
    "single-station",
}


def test_there_are_fourteen_tutorials() -> None:
    """Seven with a picture, three in space (ceiling, arrays, one station), two of arrival times, two of what moves."""
    names = [Path(name).stem for name in TUTORIALS]
    assert sorted({*names} - WITHOUT_PICTURE) == [
        "anchors-with-offsets",
        "channel-sounder",
        "direction-finding",
        "indoor-uwb",
        "over-the-horizon",
        "three-transmitters",
        "twisted-array",
    ]
    assert set(names) >= WITHOUT_PICTURE
    assert {Path(name).stem for name in TUTORIALS if not made_on(name)} == WITHOUT_PICTURE
