"""``nlosctl plot``: outputs, pipes, errors."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import FIXTURES, GOOD, Outcome

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]

PNG, SVG = b"\x89PNG", b"<?xml"


def test_plotting_a_file(cli: Cli, tmp_path: Path) -> None:
    """``plot FILE -o NAME`` writes the figure, reports the view, and does not overwrite."""
    outcome = cli("plot", GOOD, "-o", "a.svg")
    assert outcome.code == 0, outcome.err
    assert "view 'scene' in a.svg" in outcome.err
    first = (tmp_path / "a.svg").read_bytes()
    assert first.startswith(SVG)
    refused = cli("plot", GOOD, "-o", "a.svg")
    assert (refused.code, "exists already" in refused.err) == (1, True)
    assert cli("plot", GOOD, "-o", "a.svg", "--overwrite", "--title", "Another").code == 0
    assert (tmp_path / "a.svg").read_bytes() != first


def test_a_sweep_through_pipes(cli: Cli, tmp_path: Path) -> None:
    """simulate | localize | evaluate | plot gives a figure, in every format of the pipe."""
    drawn = cli("simulate", "ring", "-n", 20, "--sweep", "bearing_std_deg=0.5,2", "-q")
    fixes = cli("localize", "-", "-m", "ls", "-m", "ml", "-q", stdin=drawn.out)
    scores = cli("evaluate", "-", stdin=fixes.out)
    outcome = cli("plot", "-", "-o", "rmse.png", stdin=scores.out)
    assert outcome.code == 0, outcome.err
    assert "view 'sweep'" in outcome.err
    assert (tmp_path / "rmse.png").read_bytes().startswith(PNG)
    by_fixes = cli("plot", "-", "-o", "-", "--format", "png", stdin=fixes.out)
    assert by_fixes.out == (tmp_path / "rmse.png").read_bytes()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ([GOOD], "name the figure: -o FILE.svg"),
        ([], "name a file to plot"),
        ([GOOD, "-o", "a.gif"], "got extension '.gif', expected a picture's name that ends in one of .png, .svg, .pdf"),
        ([GOOD, "-o", "-"], "no extension"),
        ([GOOD, "-o", "a.png", "--view", "scenes"], "did you mean 'scene'?"),
        ([GOOD, "-o", "a.png", "--view", "roc"], "--view roc takes flags"),
        ([GOOD, "-o", "a.png", "--size", "6"], "--size takes WIDTHxHEIGHT in inches"),
        ([GOOD, "-o", "-", "--format", "png", "--json"], "no --json"),
    ],
)
def test_usage_errors(cli: Cli, words: list[str], text: str, tmp_path: Path) -> None:
    """Missing or invalid arguments exit 2 with the cure, without a file."""
    outcome = cli("plot", *words)
    assert outcome.code == 2
    assert text in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_invalid_files(cli: Cli, tmp_path: Path) -> None:
    """A bad file, a missing one and an unknown snapshot exit 1, without a file."""
    for words, text in (
        ([FIXTURES / "bad_nan_value.csv"], "bad_nan_value.csv"),
        (["absent.csv"], "no such file"),
        ([GOOD, "--snapshot", "nobody"], "no snapshot 'nobody'"),
    ):
        outcome = cli("plot", *words, "-o", "a.png")
        assert outcome.code == 1
        assert text in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_the_views_are_listed(cli: Cli) -> None:
    """``--views`` lists all views, or those suitable for files; --json too."""
    every = cli("plot", "--views", "--json").json
    assert [view["view"] for view in every][:2] == ["scene", "estimates"]
    assert all(view["shows"] and view["takes"] for view in every)
    assert [view["view"] for view in cli("plot", GOOD, "--views", "--json").json] == ["scene"]
    assert "echoes" in cli("plot", "--views").text
    assert "echoes" in cli("plot", "--help").text


def test_the_report_as_json(cli: Cli) -> None:
    """``--json`` has view, output and notes."""
    output = cli("plot", FIXTURES / "good_triplets.csv", "-o", "a.png", "--json").json
    assert output["view"] == "triplets"
    assert output["output"] == "a.png"


def test_notes_name_flags(cli: Cli) -> None:
    """Notes on a picture name the flags of the command line, on standard error and with --json."""
    paths = cli("simulate", "room", "-n", 1, "-q")
    outcome = cli("plot", "-", "-o", "a.png", "--json", stdin=paths.out)
    assert outcome.code == 0, outcome.err
    note = "only the first 4 of 12 paths are shown; --path selects others"
    assert json.loads(outcome.out)["notes"][0] == note
    assert f"note: {note}" in outcome.err


def test_renamed_columns_can_be_plotted(cli: Cli, tmp_path: Path) -> None:
    """``--column`` and constants work as in localize."""
    text = Path(FIXTURES / "good_bearings.csv").read_text().replace("bearing_rad", "DIRECTION", 1)
    (tmp_path / "b.csv").write_text(text)
    words = ("plot", "b.csv", "--scene", FIXTURES / "good_bearings.scene.toml", "-o", "a.png")
    assert cli(*words, "--kind", "bearings", "--column", "bearing_rad=DIRECTION").code == 0


@pytest.mark.process
def test_missing_matplotlib_is_reported(tmp_path: Path) -> None:
    """The message states how to install it; help and views still work."""
    start = (
        "import sys; sys.modules['matplotlib'] = None; from nlosctl.cli.main import run; sys.exit(run(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", start, "plot"]
    drawn = subprocess.run([*words, GOOD, "-o", tmp_path / "a.png"], capture_output=True, text=True, check=False)
    assert drawn.returncode == 1
    assert "pip install 'nlosctl[plot]'" in drawn.stderr
    assert list(tmp_path.iterdir()) == []
    listed = subprocess.run([*words, "--views"], capture_output=True, text=True, check=False)
    assert listed.returncode == 0
