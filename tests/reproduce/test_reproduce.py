"""`nlosctl reproduce`: every experiment runs, and equal seeds give equal files."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nlosctl.cli.main import run
from nlosctl.io.results.array_file import read_arrays
from nlosctl.reproduce.catalogue import chosen_names, experiment_names, find_experiment
from nlosctl.reproduce.outcome import claim_rows
from nlosctl.reproduce.sampling import draw_samples
from nlosctl.reproduce.verdicts import Verdict

pytestmark = pytest.mark.extensive

ROOT = Path(__file__).parents[2]
NAME = "madhow-fig3"


def reproduce(*words: str) -> int:
    """Run the command in this process."""
    return run(["reproduce", *words])


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Return the contents of a folder's files by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("name", experiment_names())
def test_every_experiment_runs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The quick version gives numbers, both figures, samples, and a verdict on every claim."""
    experiment = find_experiment(name)
    assert reproduce(name, "--quick", "-q", "--json", "-o", str(tmp_path)) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"{name}.parquet",
        f"{name}.png",
        f"{name}.samples.parquet",
        f"{name}.svg",
    ]
    figure, _ = read_arrays(tmp_path / f"{name}.parquet")
    assert len(figure["trials"]) == len(experiment.conditions)
    assert set(experiment.quantities) <= set(figure)
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == len(experiment.claims) + len(experiment.comparisons)
    assert len(experiment.claims) > 0
    for row in rows:
        assert row["claim"]
        assert row["ours"] is not None, row
        assert row["verdict"] in {*Verdict, None}
        assert (row["verdict"] in (Verdict.NO_NUMBERS, None)) == (row["paper"] == "")
        assert row["where"] or row["verdict"] is None
    assert (tmp_path / f"{name}.svg").stat().st_size < 300_000


def test_names_select_figures_papers_or_all() -> None:
    """A name, a paper, or all; each figure once, in the order of the papers."""
    assert chosen_names([NAME, NAME]) == [NAME]
    assert chosen_names(["madhow"]) == [name for name in experiment_names() if name.startswith("madhow-")]
    assert chosen_names(["all", NAME]) == experiment_names()


def test_names_agree() -> None:
    """The names on the command line, of the module and of the experiment agree."""
    for name in experiment_names():
        assert find_experiment(name).name == name
        assert find_experiment(name).paper.name == name.partition("-")[0]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["song-fig88"], "did you mean 'song-fig8'"),
        (["--quick"], "name a figure or table"),
        ([NAME, "--quick", "--trials", "10"], "give one"),
    ],
)
def test_invalid_arguments_are_usage_errors(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Unknown names and contradicting options are usage errors."""
    assert reproduce(*words) == 2
    assert says in capsys.readouterr().err


def test_the_list_has_every_name(capsys: pytest.CaptureFixture[str]) -> None:
    """Without a name the command lists all of them with title and paper."""
    assert reproduce("--json") == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == experiment_names()
    assert all(row["title"] and row["paper"] and row["trials"] for row in rows)


@pytest.mark.process
def test_jobs_change_no_byte(tmp_path: Path) -> None:
    """One process or two give the same files."""
    for jobs in ("1", "2"):
        assert reproduce(NAME, "--quick", "-q", "--jobs", jobs, "-o", str(tmp_path / jobs)) == 0
    assert bytes_of(tmp_path / "1") == bytes_of(tmp_path / "2")


@pytest.mark.process
def test_killed_runs_resume(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """After SIGKILL the next run gives the bytes of an uninterrupted one and reuses finished chunks."""
    words = ["reproduce", NAME, "--trials", "2000", "-o"]
    folder, parts = tmp_path / "killed", tmp_path / "killed" / f"{NAME}.parts"
    process = subprocess.Popen([sys.executable, "-m", "nlosctl.cli", *words, str(folder)], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60.0
    while not (parts.exists() and len(list(parts.glob("[0-9]*.parquet"))) >= 3) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    assert process.wait() == -9
    kept = len(list(parts.glob("[0-9]*.parquet")))
    assert 3 <= kept < 20
    assert run([*words, str(folder)]) == 0
    assert f"{1000 * kept} of them done before" in capsys.readouterr().err
    assert run([*words, str(tmp_path / "whole"), "-q"]) == 0
    assert bytes_of(folder) == bytes_of(tmp_path / "whole")


def test_samples_of_other_settings_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another seed or number of trials is refused without --overwrite, and starts again with it."""
    words = [NAME, "--trials", "50", "-q", "-o", str(tmp_path / "a")]
    assert reproduce(*words) == 0
    first = bytes_of(tmp_path / "a")
    assert reproduce(*words, "--seed", "1") == 1
    assert "--overwrite replaces it" in capsys.readouterr().err
    assert bytes_of(tmp_path / "a") == first
    assert reproduce(*words, "--seed", "1", "--overwrite") == 0
    assert reproduce(NAME, "--trials", "50", "-q", "--seed", "1", "-o", str(tmp_path / "b")) == 0
    assert bytes_of(tmp_path / "a") == bytes_of(tmp_path / "b") != first


def test_chunks_of_another_seed_are_not_used(tmp_path: Path) -> None:
    """Chunks left over from an interrupted run with another seed are not used."""
    from nlosctl.reproduce.store import SampleStore

    experiment = find_experiment(NAME)
    other = SampleStore(tmp_path, experiment, experiment.fingerprint(7, 50, "0"))
    (chunk,) = experiment.chunks(7, 50)
    other.keep(0, 0, experiment.sample(experiment.conditions[0], chunk))
    assert reproduce(NAME, "--trials", "50", "-q", "-o", str(tmp_path)) == 0
    assert reproduce(NAME, "--trials", "50", "-q", "-o", str(tmp_path / "clean")) == 0
    assert bytes_of(tmp_path / "clean") == {
        path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()
    }


def test_all_conditions_share_their_random_numbers() -> None:
    """Errors at two small spreads agree up to scale: conditions are compared on the same draws."""
    experiment = find_experiment(NAME)
    drawn, _ = draw_samples(experiment, seed=3, trials=40, store=None, jobs=1, progress=lambda done, total: None)
    one, two = drawn.of(bearing_std_deg=1.0)["ml"], drawn.of(bearing_std_deg=2.0)["ml"]
    assert two == pytest.approx(2.0 * one, rel=0.2)
    assert len(claim_rows(experiment, drawn)) == len(experiment.claims) + len(experiment.comparisons)


@pytest.mark.process
def test_without_matplotlib_only_figures_are_missing(tmp_path: Path) -> None:
    """Numbers are computed, printed and stored; one line states how to get the figures."""
    (tmp_path / "matplotlib.py").write_text(
        "raise ModuleNotFoundError(\"No module named 'matplotlib'\", name='matplotlib')\n"
    )
    words = ["reproduce", NAME, "--trials", "50", "-o", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-m", "nlosctl.cli", *words],
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin"},
    )
    assert done.returncode == 0, done.stderr
    assert "reproduced" in done.stdout
    assert sum("nlosctl[plot]" in line for line in done.stderr.splitlines()) == 1
    assert sorted(path.suffix for path in (tmp_path / "out").iterdir()) == [".parquet", ".parquet"]


def test_the_page_lists_every_claim(tmp_path: Path) -> None:
    """--page writes each claim with its verdict, failed claims, errata, and copies of the figures."""
    page = tmp_path / "docs" / "papers.md"
    page.parent.mkdir()
    words = ["song-fig6", "song-fig7", "--quick", "-q", "-o", str(tmp_path / "out"), "--page", str(page)]
    assert reproduce(*words) == 0
    text = page.read_text(encoding="utf-8")
    for name in ("song-fig6", "song-fig7"):
        experiment = find_experiment(name)
        assert f"### {name}: {experiment.title}" in text
        assert f"(figures/{name}.svg)" in text
        assert (page.parent / "figures" / f"{name}.svg").exists()
        assert sum(claim.where in text for claim in experiment.claims) == len(experiment.claims)
    assert "| Song, Willett, Zhou 2013 | 2 | 9 | 8 | 1 | 0 | 0 |" in text
    assert "| claim | where | paper | allowed | ours | verdict |" in text
    assert "scans" in text
    assert text.count("**not reproduced**") == 1
    assert "AD is twice BC" in text.split("### song-fig6")[0]
    assert text.count("t = cot(theta / 2)") == 1
    assert reproduce(*words) == 1
    assert reproduce(*words, "--overwrite") == 0
    assert page.read_text(encoding="utf-8") == text


def test_docs_papers_has_every_experiment() -> None:
    """docs/papers.md has a section for each experiment, from its own number of trials, with its figure."""
    text = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")
    for name in experiment_names():
        experiment = find_experiment(name)
        section = text.split(f"### {name}: {experiment.title}\n")
        assert len(section) == 2, name
        kind = "trials" if experiment.random else "places"
        assert f"{experiment.trials} {kind} in each" in section[1].split("### ")[0], name
        assert (ROOT / "docs" / "figures" / f"{name}.svg").stat().st_size < 400_000
