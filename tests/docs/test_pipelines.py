"""docs/pipelines.md: every pipeline runs as it stands there, and fails where it says that it does."""

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

PAGE = read_page("docs/pipelines.md")
DATA, PIPE, MAKE, XARGS, DUCKDB, CALIBRATION = PAGE.commands
WORKFLOW = ".github/workflows/fixes.yml"


def do(script: str, folder: Path, code: int = 0, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run lines of shell and hold their exit code."""
    done = run_shell(script, folder, **environment)
    assert done.returncode == code, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the data and the files of the page."""
    made = tmp_path_factory.mktemp("pipelines")
    PAGE.write(made)
    do(DATA, made)
    return made


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of that folder for one test, in which no other leaves anything."""
    return Path(shutil.copytree(made, tmp_path / "page"))


def spoil(folder: Path, into: Path) -> Path:
    """Return a copy of the folder's data and files in which one row of the second day is broken."""
    shutil.copytree(folder / "data", into / "data")
    PAGE.write(into)
    path = into / "data" / "day2.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5], lines[5].replace(".", "x"), *lines[6:]]) + "\n")
    return into


def test_the_pipe(folder: Path) -> None:
    """The pipe of four ends in figures of every snapshot."""
    do(PIPE, folder)
    assert json.loads((folder / "room.json").read_text())["overall"]["rows"] == 200


def test_make_does_what_is_new_and_checks(folder: Path) -> None:
    """The first ``make`` solves all days, the second only the one that was touched; both check all."""
    first, again = do(MAKE, folder).stdout.split("nlosctl evaluate")[:2]
    assert sorted(line.split()[-1] for line in first.splitlines()) == [f"fixes/day{k}.parquet" for k in (1, 2, 3)]
    assert [line.split()[-1] for line in again.splitlines() if line.startswith("nlosctl localize")] == [
        "fixes/day2.parquet"
    ]


def test_make_fails_where_fixes_are_bad_or_data_are(folder: Path, tmp_path: Path) -> None:
    """``make`` fails with the reason where a condition is met, and where a file is bad, and makes no half file."""
    do(MAKE, folder)
    text = (folder / "Makefile").read_text()
    assert "rmse_m>12" in text
    (tmp_path / "Makefile").write_text(text.replace("rmse_m>12", "rmse_m>2"))
    shutil.copytree(folder / "fixes", tmp_path / "fixes")
    shutil.copytree(folder / "data", tmp_path / "data")
    assert "which meets 'rmse_m>2'" in do("make -o data/day2.csv", tmp_path, code=2).stderr
    broken = spoil(folder, tmp_path / "broken")
    assert "data/day2.csv, row" in do("make -k", broken, code=2).stderr
    assert sorted(path.name for path in (broken / "fixes").iterdir()) == ["day1.parquet", "day3.parquet"]


def steps() -> tuple[list[str], dict[str, str]]:
    """Return the ``run`` lines of the workflow, and its environment."""
    job: dict[str, Any] = yaml.safe_load(PAGE.files[WORKFLOW])["jobs"]["fixes"]
    return [step["run"] for step in job["steps"] if "run" in step], job["env"]


def test_the_workflow_runs(folder: Path) -> None:
    """Each ``run`` line of the workflow succeeds after those before it, and the files to upload are there."""
    lines, environment = steps()
    assert len(lines) == 4
    for line in lines:
        do(line, folder, PIP_NO_INDEX="1", PIP_DISABLE_PIP_VERSION_CHECK="1", **environment)
    uploaded = yaml.safe_load(PAGE.files[WORKFLOW])["jobs"]["fixes"]["steps"][-1]["with"]["path"].split()
    assert [name for name in uploaded if not (folder / name).exists()] == []
    assert {group["method"] for group in json.loads((folder / "figures.json").read_text())["groups"]} == {
        "stansfield", "ml"
    }  # fmt: skip


def test_the_workflow_fails_where_it_should(folder: Path, tmp_path: Path) -> None:
    """A bad file stops the workflow at ``validate`` with 1, worse fixes at ``evaluate`` with 4."""
    (_, validate, localize, evaluate), environment = steps()
    do(validate, spoil(folder, tmp_path), code=1, **environment)
    do(localize.replace("data/*.csv", str(folder / "data" / "*.csv")), tmp_path, **environment)
    assert "ml:rmse_m>12" in evaluate
    do(evaluate.replace("rmse_m>12", "rmse_m>2"), tmp_path, code=4, **environment)


def test_find_and_xargs(folder: Path, tmp_path: Path) -> None:
    """Every file gets its own; where one is bad the exit code is 123, and the others are there."""
    do(XARGS, folder)
    assert sorted(path.name for path in (folder / "each").iterdir()) == [f"day{k}.parquet" for k in (1, 2, 3)]
    do(XARGS, spoil(folder, tmp_path), code=123)
    assert sorted(path.name for path in (tmp_path / "each").iterdir()) == ["day1.parquet", "day3.parquet"]


def need_duckdb(folder: Path) -> None:
    """Skip the test where there is no DuckDB."""
    if do("command -v duckdb || true", folder).stdout == "":
        pytest.skip("no duckdb: pip install duckdb-cli")


def test_duckdb_before_and_after(folder: Path) -> None:
    """The readings of the page become three positions that move east; SQL reads the files of fixes."""
    need_duckdb(folder)
    do(XARGS, folder)
    assert "600" in do(DUCKDB, folder).stdout
    fixes = pyarrow.parquet.read_table(folder / "positions.parquet")
    assert fixes.column("status").to_pylist() == ["ok"] * 3
    assert fixes.column("x_m").to_pylist() == sorted(fixes.column("x_m").to_pylist())
    assert fixes.column("y_m").to_pylist() == pytest.approx([1000.0] * 3, abs=100.0)


def test_offsets_of_anchors(folder: Path) -> None:
    """Offsets found in the residuals bring the fixes as near as the page tells, which they are not without."""
    need_duckdb(folder)
    do(CALIBRATION, folder)
    do("nlosctl evaluate before.parquet --truth raw.parquet --fail-if 'rmse_m>0.35'", folder, code=4)
