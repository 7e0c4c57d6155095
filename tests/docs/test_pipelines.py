"""docs/pipelines.md: every pipeline runs as it stands, and fails for bad data as the page states."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
import yaml
from doc_pages import read_page, run_shell
from warm_program import warm_path

pytestmark = pytest.mark.process

PAGE = read_page("docs/pipelines.md")
DATA, PIPE, MAKE, XARGS, FOLDER, DUCKDB, CALIBRATION = PAGE.commands
WORKFLOW = ".github/workflows/fixes.yml"


def run_checked(script: str, folder: Path, code: int = 0, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run lines of shell and check their exit code."""
    done = run_shell(script, folder, PATH=warm_path(), **environment)
    assert done.returncode == code, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the data and files of the page."""
    made = tmp_path_factory.mktemp("pipelines")
    PAGE.write(made)
    run_checked(DATA, made)
    return made


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of that folder for one test."""
    return Path(shutil.copytree(made, tmp_path / "page"))


def with_bad_row(folder: Path, into: Path) -> Path:
    """A copy of the data and files in which one row of the second day is bad."""
    shutil.copytree(folder / "data", into / "data")
    PAGE.write(into)
    path = into / "data" / "day2.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5], lines[5].replace(".", "x"), *lines[6:]]) + "\n")
    return into


def test_the_pipe(folder: Path) -> None:
    """The pipe of four commands reports figures of all snapshots."""
    run_checked(PIPE, folder)
    assert json.loads((folder / "room.json").read_text())["overall"]["rows"] == 200


def test_make_solves_what_is_new(folder: Path) -> None:
    """The first ``make`` solves all days, the second only the touched one; both evaluate all."""
    first, again = run_checked(MAKE, folder).stdout.split("nlosctl evaluate")[:2]
    assert sorted(line.split()[-1] for line in first.splitlines()) == [f"fixes/day{k}.parquet" for k in (1, 2, 3)]
    assert [line.split()[-1] for line in again.splitlines() if line.startswith("nlosctl localize")] == [
        "fixes/day2.parquet"
    ]


def test_make_fails_for_bad_fixes_and_bad_data(folder: Path, tmp_path: Path) -> None:
    """``make`` fails with the reason if a condition is met or a file is bad, and leaves no incomplete file."""
    run_checked(MAKE, folder)
    text = (folder / "Makefile").read_text()
    assert "rmse_m>12" in text
    (tmp_path / "Makefile").write_text(text.replace("rmse_m>12", "rmse_m>2"))
    shutil.copytree(folder / "fixes", tmp_path / "fixes")
    shutil.copytree(folder / "data", tmp_path / "data")
    assert "which meets 'rmse_m>2'" in run_checked("make -o data/day2.csv", tmp_path, code=2).stderr
    broken = with_bad_row(folder, tmp_path / "broken")
    assert "data/day2.csv, row" in run_checked("make -k", broken, code=2).stderr
    assert sorted(path.name for path in (broken / "fixes").iterdir()) == ["day1.parquet", "day3.parquet"]


def steps() -> tuple[list[str], dict[str, str]]:
    """The ``run`` lines of the workflow, and its environment."""
    job: dict[str, Any] = yaml.safe_load(PAGE.files[WORKFLOW])["jobs"]["fixes"]
    return [step["run"] for step in job["steps"] if "run" in step], job["env"]


def test_the_workflow_runs(folder: Path) -> None:
    """Each ``run`` line of the workflow succeeds after those before it, and the files to upload exist.

    The installed package takes the place of a clone.
    """
    lines, environment = steps()
    assert len(lines) == 4
    assert lines[0].startswith("pip install ./nlosctl")
    lines[0] = "pip install nlosctl"
    for line in lines:
        run_checked(line, folder, PIP_NO_INDEX="1", PIP_DISABLE_PIP_VERSION_CHECK="1", **environment)
    uploaded = yaml.safe_load(PAGE.files[WORKFLOW])["jobs"]["fixes"]["steps"][-1]["with"]["path"].split()
    assert [name for name in uploaded if not (folder / name).exists()] == []
    assert {group["method"] for group in json.loads((folder / "figures.json").read_text())["groups"]} == {
        "stansfield", "ml"
    }  # fmt: skip


def test_the_workflow_fails_for_bad_data(folder: Path, tmp_path: Path) -> None:
    """A bad file stops the workflow at ``validate`` with 1, bad fixes at ``evaluate`` with 4."""
    (_, validate, localize, evaluate), environment = steps()
    run_checked(validate, with_bad_row(folder, tmp_path), code=1, **environment)
    run_checked(localize.replace("data/*.csv", str(folder / "data" / "*.csv")), tmp_path, **environment)
    assert "ml:rmse_m>12" in evaluate
    run_checked(evaluate.replace("rmse_m>12", "rmse_m>2"), tmp_path, code=4, **environment)


def test_find_and_xargs(folder: Path, tmp_path: Path) -> None:
    """Every file has its output; if one file is bad the exit code is 123 and the others are complete."""
    run_checked(XARGS, folder)
    assert sorted(path.name for path in (folder / "each").iterdir()) == [f"day{k}.parquet" for k in (1, 2, 3)]
    run_checked(XARGS, with_bad_row(folder, tmp_path), code=123)
    assert sorted(path.name for path in (tmp_path / "each").iterdir()) == ["day1.parquet", "day3.parquet"]


def test_one_run_for_all_files(folder: Path) -> None:
    """The run over all files writes the estimates of the runs per file."""
    run_checked(XARGS, folder)
    run_checked(FOLDER, folder)
    for day in (1, 2, 3):
        one = pyarrow.parquet.read_table(folder / "each" / f"day{day}.parquet")
        several = pyarrow.parquet.read_table(folder / "folder" / f"day{day}.parquet")
        assert several.select(one.column_names).equals(one)


def need_duckdb(folder: Path) -> None:
    """Skip the test without DuckDB."""
    if run_checked("command -v duckdb || true", folder).stdout == "":
        pytest.skip("no duckdb: pip install duckdb-cli")


def test_duckdb_before_and_after(folder: Path) -> None:
    """The readings of the page become three positions that move east; SQL reads the fixes."""
    need_duckdb(folder)
    run_checked(XARGS, folder)
    assert "600" in run_checked(DUCKDB, folder).stdout
    fixes = pyarrow.parquet.read_table(folder / "positions.parquet")
    assert fixes.column("status").to_pylist() == ["ok"] * 3
    assert fixes.column("x_m").to_pylist() == sorted(fixes.column("x_m").to_pylist())
    assert fixes.column("y_m").to_pylist() == pytest.approx([1000.0] * 3, abs=100.0)


def test_offsets_of_anchors(folder: Path) -> None:
    """Offsets from the residuals reduce the errors to those stated on the page; without them they are larger."""
    need_duckdb(folder)
    run_checked(CALIBRATION, folder)
    run_checked("nlosctl evaluate before.parquet --truth raw.parquet --fail-if 'rmse_m>0.3'", folder, code=4)
