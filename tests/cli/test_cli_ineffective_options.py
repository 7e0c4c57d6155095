"""Options without effect: a note that names the option, or an error, in every command; none where they have one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.program import run_here

_INPUTS = {
    "b.csv": "ring -n 3",
    "r.csv": "ranges -n 3",
    "p.csv": "room -n 2",
    "echo.csv": "echo-field -n 2 -p targets=1",
    "m.csv": "madhow-ring -n 3 -p range_std_share=0.05",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of each kind."""
    made = tmp_path_factory.mktemp("inputs")
    for name, words in _INPUTS.items():
        assert run_here("simulate", *words.split(), "-q", "-o", name, folder=made).returncode == 0
    return made


def _notes(folder: Path, words: str) -> list[str]:
    done = run_here(*words.split(), "-o", "-", folder=folder)
    assert done.returncode == 0, done.stderr
    return [line for line in done.stderr.decode().splitlines() if "no effect" in line]


@pytest.mark.parametrize(
    ("words", "note"),
    [
        ("localize b.csv --field 0,1,0,1", "--field has no effect: ml has no search region"),
        ("localize r.csv -m ml -m sr-ls --field circle:0,0,1", "--field has no effect: ml, sr-ls has no search region"),
        ("localize p.csv --seed 2", "--seed has no effect: ml draws no random numbers"),
        ("detect-ip p.csv --seed 2", "--seed has no effect: chi2 draws no random numbers"),
        ("identify-los echo.csv --seed 2", "--seed has no effect: assignment draws no random numbers"),
        ("localize b.csv --alternatives 2", "--alternatives has no effect: no snapshot has a second estimate by ml"),
        ("localize b.csv --worker-timeout 3", "--worker-timeout has no effect: it is for the engine dask"),
        ("localize b.csv --all-rows", "--all-rows has no effect: the input has no column los or ip"),
        ("bound b.csv --all-rows", "--all-rows has no effect: the input has no column los or ip"),
        ("localize b.csv --range-std-m 2", "--range-std-m has no effect: the bearings have no column 'range_m'"),
        ("bound b.csv --range-std-m 2", "--range-std-m has no effect: the bearings have no column 'range_m'"),
    ],
)
def test_an_option_without_effect_is_noted(folder: Path, words: str, note: str) -> None:
    """The summary has one line on the option."""
    (line,) = _notes(folder, words)
    assert note in line


@pytest.mark.parametrize(
    "words",
    [
        "localize b.csv -m ml -m mixture-ml --field sensors:3 --seed 3",
        "identify-los echo.csv --field 0,1000,0,1000",
        "localize r.csv -m mixture-ml --seed 3",
        "localize b.csv --seed 0 --alternatives 1",
    ],
)
def test_an_option_with_an_effect_is_not_noted(folder: Path, words: str) -> None:
    """No line where a method of the run uses the option, or where it is at its default."""
    assert _notes(folder, words) == []


@pytest.mark.parametrize("words", ["localize b.csv", "localize p.csv", "bound b.csv", "bound m.csv"])
def test_heights_of_targets_are_for_ranges(folder: Path, words: str) -> None:
    """`--target-z-m` with bearings or triplets is an error that names the option."""
    done = run_here(*words.split(), "--target-z-m", "2", folder=folder)
    assert done.returncode == 2
    assert b"--target-z-m is for files of ranges" in done.stderr


def test_the_bound_without_ranges_of_a_file_without(folder: Path) -> None:
    """`bound --no-ranges` states that there is nothing to leave out, unless there is."""
    for name, count in (("b.csv", 1), ("r.csv", 1), ("m.csv", 0)):
        done = run_here("bound", name, "--no-ranges", "-o", "-", folder=folder)
        assert done.stderr.count(b"ranges are not left out") == count


def test_competing_paths_are_noted(folder: Path) -> None:
    """Methods that trust every row have a note on several paths of a sensor; others, and single paths, have none."""
    words = ("-n", "3", "-p", "paths=3", "-q", "-o", "k.csv")
    assert run_here("simulate", "madhow-ring", *words, folder=folder).returncode == 0
    done = run_here("localize", "k.csv", "-m", "ml", "-m", "mixture-ml", "-m", "sequential", "-o", "-", folder=folder)
    (line,) = [line for line in done.stderr.decode().splitlines() if "'path'" in line]
    assert "the column 'path' is not used by ml, sequential: 72 rows are several paths of one sensor" in line
    header, *rows = (folder / "b.csv").read_text().splitlines()
    (folder / "one.csv").write_text("\n".join([f"{header},path", *(f"{row},0" for row in rows), ""]))
    for words in (("k.csv", "-m", "suppress"), ("one.csv", "-m", "ml")):
        assert b"'path'" not in run_here("localize", *words, "-o", "-", folder=folder).stderr
    header, *rows = (folder / "r.csv").read_text().splitlines()
    for numbers, count in (("01", 1), ("", 0)):
        repeated = [f"{row},{numbers[at:][:1]}" for row in rows for at in (0, 1)]
        (folder / "two.csv").write_text("\n".join([f"{header},path", *repeated, ""]))
        done = run_here("localize", "two.csv", "-o", "-", folder=folder)
        assert done.stderr.count(b"the column 'path' is not used by ml") == count, done.stderr


def test_no_candidate_is_explained_once(folder: Path) -> None:
    """Where no snapshot has a fix, one line names `--field`: the advice; where some have, the note alone."""
    words = ("--field", "10,11,10,11", "-p", "use_ranges=false", "-p", "search_outside=false", "-o", "-")
    done = run_here("localize", "m.csv", "-m", "mixture-ml", *words, folder=folder)
    assert b"no_candidate" in done.stdout
    (line,) = [line for line in done.stderr.decode().splitlines() if "enlarge it" in line]
    assert "no snapshot has a fix (3 of 3 are no_candidate)" in line
    done = run_here(
        "localize", "m.csv", "-m", "mixture-ml", "-m", "stansfield", *words[:-4], *words[-2:], folder=folder
    )
    (line,) = [line for line in done.stderr.decode().splitlines() if "enlarge it" in line]
    assert line.startswith("note: mixture-ml: in 3 of 3 snapshots")


@pytest.mark.parametrize(
    ("words", "ineffective"),
    [
        ("e.csv --view cdf --by method --snapshot 1", ["--snapshot", "--by"]),
        ("e.csv --view estimates --linear", ["--linear"]),
        ("b.csv --y rms_m", ["--y"]),
        ("b.csv --snapshot 1", []),
        ("e.csv --view cdf --linear", []),
    ],
)
def test_options_of_other_views_are_noted(folder: Path, words: str, ineffective: list[str]) -> None:
    """`plot` notes each option that the view does not use."""
    estimates = ("localize", "b.csv", "-o", "e.csv", "-q", "--overwrite")
    assert run_here(*estimates, folder=folder).returncode == 0
    done = run_here("plot", *words.split(), "-o", "p.svg", "--overwrite", folder=folder)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.decode().splitlines() if "no effect" in line]
    assert [line.split()[1] for line in lines] == ineffective
