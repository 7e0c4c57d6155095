"""Options estimated from the whole input: the same bytes however it is read, and what is reported."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.limits import size_variable
from nlosctl.errors import UsageError

WORDS = ("localize", "-m", "mixture-ml", "-p", "alpha=estimate")
SNAPSHOTS = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``m.parquet``, ``m.csv``, and ``in/``: the same rows in parts that cut snapshots."""
    folder = tmp_path_factory.mktemp("estimated")
    world = ("-p", "nlos_receivers=3", "-p", "nlos_span_deg=360", "-p", "bearing_std_deg=2", "-n", str(SNAPSHOTS), "-q")
    for name in ("m.parquet", "m.csv"):
        assert run_here("simulate", "madhow-ring", *world, "-o", name, folder=folder).returncode == 0
    table = pyarrow.parquet.read_table(folder / "m.parquet")
    (folder / "in").mkdir()
    for number, (first, behind) in enumerate(pairwise([0, 131, 250, table.num_rows])):
        pyarrow.parquet.write_table(table.slice(first, behind - first), folder / "in" / f"p{number}.parquet")
    return folder


def estimates(folder: Path, *words: str, stdin: bytes = b"") -> bytes:
    """Return the estimates of a run as CSV."""
    done = run_here(*WORDS, *words, "-q", folder=folder, stdin=stdin)
    assert done.returncode == 0, done.stderr
    return done.stdout


def estimated(folder: Path, *words: str) -> float:
    """Return the estimated share of outliers."""
    assert (
        run_here(*WORDS, *words, "-q", "-o", "e.csv", "--overwrite", "--report", "r.json", folder=folder).returncode
        == 0
    )
    return float(json.loads((folder / "r.json").read_text())["methods"]["mixture-ml"]["estimated"]["values"]["alpha"])


def test_the_bytes_do_not_depend_on_how_the_input_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs, block sizes, chunk sizes, parts and standard input give the bytes of the estimated value typed by hand."""
    alpha = estimated(folder, "m.parquet")
    assert alpha == pytest.approx(3 / 8, abs=0.03)
    done = run_here(*WORDS[:-1], f"alpha={alpha}", "-q", "m.parquet", folder=folder)
    expected = done.stdout
    assert len(expected.splitlines()) == SNAPSHOTS + 1
    for words in (["--jobs", "1"], ["--jobs", "2"], ["--block-size", "7"]):
        assert estimates(folder, "m.parquet", *words) == expected
    assert estimates(folder, "-", stdin=(folder / "m.parquet").read_bytes()) == expected
    assert estimates(folder, "m.csv") == estimates(folder, "-", stdin=(folder / "m.csv").read_bytes()) == expected
    for name in ("chunk_rows", "slice_rows"):
        monkeypatch.setenv(size_variable(name), "100")
    assert estimates(folder, "in", "--jobs", "2") == estimates(folder, "m.parquet", "--jobs", "1") == expected


def test_folders_and_resumed_runs_have_the_value_of_the_whole_input(folder: Path) -> None:
    """Each part of a folder is solved with the value of all parts; a resumed run changes nothing."""
    words = (*WORDS, "in", "-o", "out/", "-q")
    assert run_here(*words, folder=folder).returncode == 0
    parts = sorted((folder / "out").glob("*.parquet"))
    first = [part.read_bytes() for part in parts]
    whole = pyarrow.parquet.read_table(folder / "out")
    assert run_here(*WORDS, "in", "-o", "whole.parquet", "-q", folder=folder).returncode == 0
    assert whole.equals(pyarrow.parquet.read_table(folder / "whole.parquet"))
    assert run_here(*words, "--resume", folder=folder).returncode == 0
    assert [part.read_bytes() for part in parts] == first


def test_python_gives_the_same_bits(folder: Path) -> None:
    """The function on a table estimates the same value."""
    table = pyarrow.parquet.read_table(folder / "m.parquet")
    result = nlosctl.localize(table, method="mixture-ml", alpha="estimate")
    assert result.report.learned["mixture-ml"].values == {"alpha": estimated(folder, "m.parquet")}


def test_the_value_is_in_summary_report_and_provenance(folder: Path) -> None:
    """The number of passes too."""
    done = run_here(*WORDS, "m.parquet", "-o", "named.parquet", "--report", "named.json", folder=folder)
    report = json.loads((folder / "named.json").read_text())["methods"]["mixture-ml"]["estimated"]
    assert report["settled"]
    assert 2 <= report["passes"] <= 10
    note = f"mixture-ml: alpha = {report['values']['alpha']}, estimated in {report['passes']} passes over the input"
    assert note in done.stderr.decode()
    metadata = pyarrow.parquet.read_schema(folder / "named.parquet").metadata
    (method,) = json.loads(metadata[b"nlosctl"])["methods"]
    assert (method["parameters"]["alpha"], method["estimated"]) == (report["values"]["alpha"], ["alpha"])


def test_bad_rows_are_set_aside_in_every_pass(folder: Path) -> None:
    """A bad row raises the usual error without ``--bad-rows``; with it it has no influence."""
    lines = (folder / "m.csv").read_text().splitlines()
    bad = [*lines[:9], "nonsense".join(["", *[","] * lines[0].count(",")]), *lines[9:]]
    (folder / "bad.csv").write_text("\n".join(bad) + "\n")
    refused = run_here(*WORDS, "bad.csv", folder=folder)
    assert refused.returncode == 1
    assert refused.stderr == run_here("localize", "-m", "mixture-ml", "bad.csv", folder=folder).stderr
    assert estimated(folder, "bad.csv", "--bad-rows", "aside.csv") == estimated(folder, "m.csv")
    assert len((folder / "aside.csv").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["-p", "alpha=estimate", "--max-spool-bytes", "1000"], 1, "stdin: more than 1000 bytes"),
        (["-p", "alpha=estimate", "--max-spool-bytes", "1000"], 1, "raise --max-spool-bytes"),
        (["-p", "alpha=estimate", "--sweep", "alpha=0.1,0.2"], 2, "'alpha' is given by --param and by --sweep"),
        (["-p", "max_modes=estimate"], 2, "must be an int"),
        (["-p", "alpha=estimate", "--engine", "dask"], 2, "standard input cannot be distributed"),
    ],
)
def test_refusals(folder: Path, words: list[str], code: int, message: str) -> None:
    """Each is one line that names the cure."""
    done = run_here("localize", "-m", "mixture-ml", "-", *words, folder=folder, stdin=(folder / "m.csv").read_bytes())
    assert (done.returncode, message in done.stderr.decode()) == (code, True), done.stderr


def test_ranges_without_late_outliers_refuse_a_mean_bias() -> None:
    """The message names the option to change."""
    table = {"sensor": [1, 2, 3], "sensor_x_m": [0.0, 1.0, 0.0], "sensor_y_m": [0.0, 0.0, 1.0], "range_m": [1.0] * 3}
    for parameters, match in (({}, "set bias=positive"), ({"bias": "none", "alpha": "estimate"}, "set bias=both")):
        with pytest.raises(UsageError, match=match):
            nlosctl.localize(
                {**table, "range_std_m": [0.1] * 3}, method="mixture-ml", **{"bias_mean_m": "estimate", **parameters}
            )
