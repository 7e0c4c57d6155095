"""Folders in and out: part files, the manifest, resuming, refusals."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from cli_support import (
    FIXTURES,
    GOOD,
    PROGRAM,
    SCENE,
    Outcome,
    crossing_rows,
    plain_csv,
    plain_environment,
    read_parquet,
)

from nlosctl.pipeline.engine.parts import PartWork
from nlosctl.pipeline.engine.slices import SliceWork

pytestmark = pytest.mark.process

Cli = Callable[..., Outcome]
CUTS = (0, 101, 150, 152, 153, 200, 240)  # of the 240 good rows: snapshots of 6 rows are cut, one over three parts


def parts_of(table: Any, folder: Path, cuts: tuple[int, ...] = CUTS, **options: Any) -> Path:
    """Write a table as the parts of a folder, cut at rows."""
    folder.mkdir(parents=True)
    for number, (first, behind) in enumerate(pairwise(cuts)):
        pa.parquet.write_table(table.slice(first, behind - first), folder / f"p{number}.parquet", **options)
    return folder


def together(folder: Path) -> Any:
    """Return the part files of a folder as one table, in order of their names."""
    return pa.concat_tables([read_parquet(path) for path in sorted(folder.glob("*.parquet"))])


def content(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file in a folder, by its name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a folder."""
    recorded: dict[str, Any] = json.loads((folder / "_manifest.json").read_text())
    return recorded


@pytest.fixture
def good(tmp_path: Path) -> Path:
    """The valid bearings, cut into parts."""
    return parts_of(read_parquet(GOOD), tmp_path / "in", row_group_size=40)


def test_parts_equal_a_single_file(cli: Cli, good: Path, tmp_path: Path) -> None:
    """Concatenated part files are the rows of a single file; there is one for each input part."""
    words = ("localize", good, "--scene", SCENE, "-m", "ml", "-m", "ls")
    assert cli(*words, "-o", "one.parquet", "--flags-out", "flags.parquet").code == 0
    outcome = cli(*words, "-o", "out/", "--flags-out", "fout/")
    assert outcome.code == 0, outcome.err
    for folder, single in (("out", "one"), ("fout", "flags")):
        assert sorted(path.name for path in (tmp_path / folder).glob("*.parquet")) == [
            f"p{n}.parquet" for n in range(6)
        ]
        assert together(tmp_path / folder).equals(read_parquet(tmp_path / f"{single}.parquet"))


def test_a_snapshot_belongs_to_the_part_where_it_begins(cli: Cli, tmp_path: Path) -> None:
    """Rows in later parts belong to the part of the first row, even over whole parts."""
    rows = [row for snapshot in range(4) for row in crossing_rows(snapshot, 4)]
    (tmp_path / "in").mkdir()
    for number, (first, behind) in enumerate([(0, 3), (3, 6), (6, 7), (7, 16)]):
        (tmp_path / "in" / f"p{number}.csv").write_text(plain_csv(rows[first:behind]))
    assert cli("localize", "in", "-m", "ls", "-o", "out/", "-q").code == 0
    ids = [read_parquet(tmp_path / "out" / f"p{n}.parquet").column("snapshot").to_pylist() for n in range(4)]
    assert ids == [[0], [1], [], [2, 3]]
    assert set(together(tmp_path / "out").column("n_used").to_pylist()) == {4}


def test_the_summary_adds_up(cli: Cli, good: Path) -> None:
    """The summary and report of the parts are those of a single file."""
    words = ("localize", good, "--scene", SCENE, "--report", "-")
    outcome, parts = cli(*words, "-o", "one.parquet"), cli(*words, "-o", "out/")
    assert parts.err == outcome.err


def test_the_manifest_records_the_run(cli: Cli, good: Path, tmp_path: Path) -> None:
    """Version, method, parameters, seed, inputs with size and rows; parts with rows, bytes, hash, statuses."""
    import hashlib

    from nlosctl import __version__

    assert cli("localize", good, "--scene", SCENE, "-m", "ml", "-p", "max_iterations=9", "-o", "out", "-q").code == 2
    assert cli("localize", good, "--scene", SCENE, "-m", "ml", "-p", "max_iterations=9", "-o", "out/", "-q").code == 0
    recorded = manifest(tmp_path / "out")
    assert (recorded["version"], recorded["command"], recorded["seed"]) == (__version__, "localize", 0)
    assert recorded["methods"][0]["parameters"]["max_iterations"] == 9
    assert [given["rows"] for given in recorded["inputs"]] == [101, 49, 2, 1, 47, 40]
    assert [given["bytes"] for given in recorded["inputs"]] == [path.stat().st_size for path in sorted(good.iterdir())]
    for part in recorded["parts"]:
        path = tmp_path / "out" / part["name"]
        assert part["bytes"] == path.stat().st_size
        assert part["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert part["rows"] == read_parquet(path).num_rows
        assert sum(part["record"]["counts"]["methods"]["ml"]["statuses"].values()) == part["rows"]
    assert sum(part["rows"] for part in recorded["parts"]) == recorded["rows"] == 40
    assert not (tmp_path / "out" / "_unfinished").exists()


@pytest.mark.parametrize(
    ("command", "source", "other"),
    [
        ("detect-ip", "good_triplets.csv", "--estimates-out"),
        ("identify-los", "good_echoes.csv", "--estimates-out"),
        ("bound", "good_bearings.csv", None),
    ],
)
def test_every_mapping_command_writes_folders(
    cli: Cli, tmp_path: Path, command: str, source: str, other: str | None
) -> None:
    """detect-ip, identify-los and bound write in parts the rows of a single file."""
    header, *rows = (FIXTURES / source).read_text().splitlines(keepends=True)
    (tmp_path / "in").mkdir()
    third = len(rows) // 3
    for number, piece in enumerate((rows[:third], rows[third : 2 * third], rows[2 * third :])):
        (tmp_path / "in" / f"p{number}.csv").write_text(header + "".join(piece))
    scene = ("--scene", SCENE) if command == "bound" else ()
    words = (command, "in", *scene, "-q")
    assert cli(*words, "-o", "one.parquet", *([other, "two.parquet"] if other else [])).code == 0
    outcome = cli(*words, "-o", "out/", *([other, "two/"] if other else []))
    assert outcome.code == 0, outcome.err
    assert together(tmp_path / "out").equals(read_parquet(tmp_path / "one.parquet"))
    if other:
        assert together(tmp_path / "two").equals(read_parquet(tmp_path / "two.parquet"))
        assert manifest(tmp_path / "two")["table"] == "estimates"


@pytest.mark.parametrize("extension", ["csv", "csv.gz", "parquet", "arrow", "arrows", "jsonl"])
def test_parts_of_any_format(cli: Cli, tmp_path: Path, extension: str) -> None:
    """Any input and output format; the extension of part files is that of their format."""
    (tmp_path / "in").mkdir()
    source = FIXTURES / f"good_bearings.{extension}"
    (tmp_path / "in" / f"b.{extension}").write_bytes(source.read_bytes())
    words = ("localize", "in", "--scene", SCENE, "-q", "--format", extension)
    assert cli(*words, "-o", f"one.{extension}").code == 0
    assert cli(*words, "-o", "out/").code == 0
    again = cli("localize", "in", "--scene", SCENE, "-q", "-o", "again/", "--format", extension)
    assert again.code == 0
    assert content(tmp_path / "out") == content(tmp_path / "again")
    if extension in ("csv", "csv.gz", "jsonl"):  # the others carry the names of their inputs: one folder, or one part
        assert (tmp_path / "out" / f"b.{extension}").read_bytes() == (tmp_path / f"one.{extension}").read_bytes()


def test_workers_and_blocks_change_no_byte_of_the_parts(cli: Cli, good: Path, tmp_path: Path) -> None:
    """Part files and manifests are the same for any ``--jobs`` and ``--block-size``."""
    words = ("localize", good, "--scene", SCENE, "-m", "ml", "-q")
    assert cli(*words, "-o", "one/", "--jobs", 1).code == 0
    assert cli(*words, "-o", "two/", "--jobs", 3, "--block-size", 7).code == 0
    assert content(tmp_path / "one") == content(tmp_path / "two")


def killed_run(words: list[str], cwd: Path, after: Path) -> None:
    """Start the program and kill it with SIGKILL once a file exists."""
    with subprocess.Popen([str(PROGRAM), *words], cwd=cwd, env=plain_environment()) as process:
        deadline = time.monotonic() + 60
        while not after.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL, "the run ended before it could be killed"


def test_a_killed_run_is_resumed_to_the_same_bytes(cli: Cli, tmp_path: Path) -> None:
    """After kill -9 ``--resume`` makes only the missing parts, with the same bytes."""
    table = pa.concat_tables([read_parquet(GOOD)] * 30)
    ids = [40 * (row // 240) + old for row, old in enumerate(table.column("snapshot").to_pylist())]
    table = table.set_column(table.column_names.index("snapshot"), "snapshot", pa.array(ids))
    parts_of(table, tmp_path / "in", tuple(range(0, table.num_rows + 1, 800)))
    words = ["localize", "in", "--scene", str(SCENE), "-m", "ml", "-q", "--flags-out"]
    assert cli(*words, "whole_f/", "-o", "whole/").code == 0
    killed_run([*words, "out_f/", "-o", "out/"], tmp_path, tmp_path / "out" / "_unfinished" / "000002.json")
    out = tmp_path / "out"
    assert not (out / "_manifest.json").exists()
    refused = cli(*words, "out_f/", "-o", "out/")
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert "--resume" in refused.err
    done = {
        path: path.stat().st_mtime_ns for path in out.glob("p*.parquet") if path.name in ("p0.parquet", "p1.parquet")
    }
    (out / ".p7.parquet.abcdefgh.part").write_bytes(b"left by the killed run")
    resumed = cli(*words, "out_f/", "-o", "out/", "--resume")
    assert resumed.code == 0, resumed.err
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert content(out) == content(tmp_path / "whole")
    assert content(tmp_path / "out_f") == content(tmp_path / "whole_f")


def test_missing_and_changed_parts_are_made_again(cli: Cli, good: Path, tmp_path: Path) -> None:
    """``--resume`` on a finished folder makes only missing or changed parts."""
    words = ("localize", good, "--scene", SCENE, "-o", "out/", "-q")
    assert cli(*words).code == 0
    before = content(tmp_path / "out")
    (tmp_path / "out" / "p1.parquet").unlink()
    (tmp_path / "out" / "p4.parquet").write_bytes(b"corrupted")
    times = {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in ("p0.parquet", "p5.parquet")}
    assert cli(*words, "--resume").code == 0
    assert content(tmp_path / "out") == before
    assert {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in times} == times
    assert cli(*words, "--resume").code == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("-m", "ls"), "bearings.ls"),
        (("-p", "max_iterations=3"), "max_iterations was 30 and is 3"),
        (("--seed", "7"), "seed was 0 and is 7"),
        (("--format", "csv"), 'format was "parquet" and is "csv"'),
        (("--flags-out", "fout/"), "tables"),
        (("--all-rows",), "all_rows"),
        (("--field=0,1000.0001,0,600",), "field was"),
        (("--field=polygon:0,0;900,0;900,900",), "field was"),
    ],
)
def test_resume_refuses_another_run(
    cli: Cli, good: Path, tmp_path: Path, change: tuple[str, ...], message: str
) -> None:
    """Other parameters are refused in one line that names them, and nothing changes."""
    assert cli("localize", good, "--scene", SCENE, "-o", "out/", "-q").code == 0
    before = content(tmp_path / "out")
    refused = cli("localize", good, "--scene", SCENE, "-o", "out/", "-q", "--resume", *change)
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert message in refused.err
    assert content(tmp_path / "out") == before


@pytest.mark.parametrize(
    ("begun", "resumed"),
    [
        ("0,1000.0001,0,600", "0,1000.0004,0,600"),
        ("circle:0,0,1000.00001", "circle:0,0,1000.00002"),
        ("polygon:0,0;1000,0;1000,600", "polygon:0,0;10,0;10,6"),
    ],
)
def test_resume_refuses_another_search_region(cli: Cli, good: Path, tmp_path: Path, begun: str, resumed: str) -> None:
    """Regions are compared by their exact numbers, not by a rounded text or a number of vertices."""
    words = ["localize", good, "--scene", SCENE, "-o", "out/", "-q"]
    assert cli(*words, f"--field={begun}").code == 0
    refused = cli(*words, "--resume", f"--field={resumed}")
    assert (refused.code, "field was" in refused.err) == (1, True)


def test_resume_refuses_another_speed(cli: Cli, tmp_path: Path) -> None:
    """The speed that makes distances of times decides the results, so a run with another one is not continued."""
    words = ["localize", FIXTURES / "arrivals" / "good_sound.csv", "-o", "out/", "-q", "--speed-m-s"]
    assert cli(*words, "sound").code == 0
    refused = cli(*words, "300", "--resume")
    assert (refused.code, "speed_m_s was 343.0" in refused.err) == (1, True)
    assert cli(*words, "343", "--resume").code == 0


@pytest.mark.parametrize("finished", [True, False])
def test_resume_refuses_changed_inputs(cli: Cli, good: Path, tmp_path: Path, finished: bool) -> None:
    """A changed input is refused by name, in finished and unfinished runs; so is a new one."""
    words = ("localize", good, "--scene", SCENE, "-o", "out/", "-q")
    if finished:
        assert cli(*words).code == 0
    else:
        break_the_last(cli, words, good)
    content_of_p2 = (good / "p2.parquet").read_bytes()
    (good / "p2.parquet").write_bytes(content_of_p2)  # the same size
    refused = cli(*words, "--resume")
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert "p2.parquet has changed" in refused.err


def break_the_last(cli: Cli, words: tuple[Any, ...], folder: Path) -> None:
    """Run over inputs whose last part has a bad row: earlier parts are made, then the run stops."""
    last = folder / "p5.parquet"
    table = read_parquet(last)
    index = table.column_names.index("bearing_std_rad")
    bad = pa.array([-1.0] * table.num_rows)
    pa.parquet.write_table(table.set_column(index, "bearing_std_rad", bad), last)
    outcome = cli(*words)
    assert outcome.code == 1
    assert "p5.parquet" in outcome.err


def test_bad_rows_stop_at_their_part_and_can_be_set_aside(cli: Cli, good: Path, tmp_path: Path) -> None:
    """A bad row stops the run without a manifest; ``--bad-rows FOLDER/`` sets it aside by part."""
    words = ("localize", good, "--scene", SCENE, "-q")
    break_the_last(cli, (*words, "-o", "out/"), good)
    assert not (tmp_path / "out" / "_manifest.json").exists()
    assert cli(*words, "-o", "out2/", "--bad-rows", "bad.csv").code == 2
    assert cli(*words, "-o", "out2/", "--bad-rows", "bad/").code == 0
    assert cli(*words, "-o", "one.parquet", "--bad-rows", "bad.parquet").code == 0
    assert together(tmp_path / "out2").equals(read_parquet(tmp_path / "one.parquet"))
    assert together(tmp_path / "bad").equals(read_parquet(tmp_path / "bad.parquet"))


def test_snapshots_repeated_in_another_part_are_refused(cli: Cli, tmp_path: Path) -> None:
    """The parts of a folder are one table: parts that each count from 0 are an error."""
    (tmp_path / "in").mkdir()
    for name in "ab":
        (tmp_path / "in" / f"{name}.csv").write_text(plain_csv([*crossing_rows(0), *crossing_rows(1)]))
    single, parts = cli("localize", "in", "-o", "one.csv"), cli("localize", "in", "-o", "out/")
    assert (parts.code, single.code) == (1, 1)
    assert "comes back" in parts.err
    assert parts.err == single.err
    assert not (tmp_path / "out" / "_manifest.json").exists()


@pytest.mark.parametrize("method", ["mixture-ml", "suppress", "sequential"])
def test_parts_have_the_bits_of_the_whole(cli: Cli, tmp_path: Path, method: str) -> None:
    """An estimate does not depend on the sensors in earlier parts."""
    assert cli("simulate", "random", "-n", 60, "-p", "sensors=6", "-p", "mirrors=0", "-o", "m.parquet", "-q").code == 0
    table = read_parquet(tmp_path / "m.parquet")
    sensors = [f"s{(7 * row) % 11}-{row % 6}" for row in range(table.num_rows)]
    table = table.set_column(table.column_names.index("sensor"), "sensor", pa.array(sensors))
    parts_of(table, tmp_path / "in", (0, 100, 200, 301, 360))
    words = ("localize", "in", "-m", method, "-q")
    assert cli(*words, "-o", "one.parquet", "--flags-out", "f.parquet").code == 0
    assert cli(*words, "-o", "out/", "--flags-out", "fout/").code == 0
    assert together(tmp_path / "out").equals(read_parquet(tmp_path / "one.parquet"))
    assert together(tmp_path / "fout").equals(read_parquet(tmp_path / "f.parquet"))


def test_ids_need_not_rise(cli: Cli, tmp_path: Path) -> None:
    """Snapshot ids in any order are accepted, as long as none is repeated later."""
    (tmp_path / "in").mkdir()
    for name, ids in (("a", ["x", "b", "k"]), ("b", ["c", "z", "a"])):
        rows = [row for identity in ids for row in crossing_rows(identity)]
        (tmp_path / "in" / f"{name}.csv").write_text(plain_csv(rows))
    assert cli("localize", "in", "-o", "out/", "-q").code == 0
    assert together(tmp_path / "out").column("snapshot").to_pylist() == ["x", "b", "k", "c", "z", "a"]


def test_folders_with_other_files_are_refused(cli: Cli, good: Path, tmp_path: Path) -> None:
    """A folder with other files is refused, with and without ``--overwrite``; so is the input's folder."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    for extra in ((), ("--overwrite",), ("--resume",)):
        refused = cli("localize", good, "--scene", SCENE, "-o", "out", *extra)
        assert (refused.code, refused.err.count("\n")) == (1, 1)
        assert "thesis.txt" in refused.err
    assert cli("localize", good, "--scene", SCENE, "-o", good, "--overwrite").code == 1
    assert cli("localize", good / "p0.parquet", "--scene", SCENE, "-o", f"{good}/", "--overwrite").code == 1
    assert sorted(path.name for path in good.iterdir()) == [f"p{n}.parquet" for n in range(6)]


def test_overwrite_replaces_only_listed_parts(cli: Cli, good: Path, tmp_path: Path) -> None:
    """``--overwrite`` removes the files in the manifest, and follows no name or link out of the folder."""
    words = ("localize", good, "--scene", SCENE, "-q", "-o", "out/")
    assert cli(*words, "-m", "ls").code == 0
    victim, elsewhere = tmp_path / "victim.parquet", tmp_path / "elsewhere"
    victim.write_bytes(b"not ours")
    elsewhere.mkdir()
    (elsewhere / "p.parquet").write_bytes(b"not ours")
    (tmp_path / "out" / "link").symlink_to(elsewhere)
    recorded = manifest(tmp_path / "out")
    for index, name in enumerate(("../victim.parquet", str(victim), "link/p.parquet")):
        recorded["parts"][index]["name"] = name
        recorded["parts"][index]["record"]["files"]["estimates"]["name"] = name
    (tmp_path / "out" / "_manifest.json").write_text(json.dumps(recorded))
    outcome = cli(*words, "-m", "ml", "--overwrite")
    assert victim.read_bytes() == (elsewhere / "p.parquet").read_bytes() == b"not ours"
    assert outcome.code == 1, "the link is a stranger in the folder"
    assert "other files" in outcome.err


def test_overwrite_starts_again(cli: Cli, good: Path, tmp_path: Path) -> None:
    """``--overwrite`` removes old parts of any format and writes what a new folder would have."""
    words = ("localize", good, "--scene", SCENE, "-q", "-m", "ls")
    assert cli(*words, "-o", "out/", "--format", "csv").code == 0
    assert cli(*words, "-o", "out/").code == 1
    assert cli(*words, "-o", "out/", "--overwrite").code == 0
    assert cli(*words, "-o", "new/").code == 0
    assert content(tmp_path / "out") == content(tmp_path / "new")


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("-o", "out/", "--flags-out", "f.parquet"), 2, "f.parquet"),
        (("-o", "e.parquet", "--flags-out", "f/"), 2, "e.parquet"),
        (("--flags-out", "f/"), 2, "-: the other tables"),
        (("-o", "e.parquet", "--resume"), 2, "--resume"),
        (("-o", "no/such/out/"), 1, "no folder"),
        (("-o", "same/", "--flags-out", "same/"), 2, "the same output"),
    ],
)
def test_contradicting_outputs(cli: Cli, tmp_path: Path, words: tuple[str, ...], code: int, message: str) -> None:
    """Files and folders can't be mixed, ``--resume`` needs a folder: one line each, and nothing is written."""
    outcome = cli("localize", GOOD, *words)
    assert (outcome.code, outcome.err.count("\n")) == (code, 1), outcome.err
    assert message in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_streams_can_not_go_to_folders(cli: Cli) -> None:
    """A stream can't be resumed, so it goes to a file."""
    refused = cli("localize", "-", "--scene", SCENE, "-o", "out/", stdin=GOOD.read_bytes())
    assert (refused.code, refused.err.count("\n")) == (2, 1)


def test_part_names_are_safe_and_unique(cli: Cli, tmp_path: Path) -> None:
    """Names that readers skip are changed, equal names are made distinct, none is lost."""
    names = ["in1/a.csv", "in1/a.jsonl", "in2/a.csv", "in2/_hidden.csv", "in2/..csv", "in2/sp ace%2F..csv"]
    for number, name in enumerate(names):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        rows = crossing_rows(number)
        text = plain_csv(rows)
        if name.endswith("jsonl"):
            keys = text.splitlines()[0].split(",")
            text = "".join(json.dumps(dict(zip(keys, row, strict=True))) + "\n" for row in rows)
        (tmp_path / name).write_text(text)
    outcome = cli("localize", *names, "-o", "out/", "-q", "--format", "csv")
    assert outcome.code == 0, outcome.err
    recorded = manifest(tmp_path / "out")
    assert [part["input"] for part in recorded["parts"]] == names
    assert [part["name"] for part in recorded["parts"]] == [
        "a.csv.csv",
        "a.jsonl.csv",
        "a.csv-2.csv",
        "part_hidden.csv",
        "part..csv",
        "sp ace%2F..csv",
    ]


def test_folders_named_key_value_give_columns(cli: Cli, tmp_path: Path) -> None:
    """``year=2026`` becomes a column, integer if all are; a column of the file takes precedence."""
    for number, folder in enumerate(["day=01/site=a%20b", "day=01/site=c", "day=2/site=__HIVE_DEFAULT_PARTITION__"]):
        (tmp_path / "in" / folder).mkdir(parents=True)
        (tmp_path / "in" / folder / "m.csv").write_text(plain_csv(crossing_rows(number)))
    assert cli("localize", "in", "-m", "ls", "-o", "out/", "--carry", "day", "--carry", "site", "-q").code == 0
    assert (
        cli("localize", "in", "-m", "ls", "-o", "one.parquet", "--flags-out", "f.parquet", "--carry", "site").code == 0
    )
    first = read_parquet(tmp_path / "out" / "day=01" / "site=a%20b" / "m.parquet")
    assert (first.column("day").to_pylist(), first.column("site").to_pylist()) == (["01"], ["a b"])
    assert read_parquet(tmp_path / "one.parquet").column("site").to_pylist() == ["a b", "c", None]
    assert read_parquet(tmp_path / "f.parquet").column("day").to_pylist() == ["01"] * 6 + ["2"] * 3
    again = cli("localize", "out", "--column", "snapshot=snapshot")
    assert again.code == 1, "estimates are no measurements"


def test_keys_can_be_columns_of_the_contract(cli: Cli, tmp_path: Path) -> None:
    """A folder may give the snapshot or a std; an invalid value is reported with its file."""
    for snapshot in (10, 9):
        folder = tmp_path / "in" / f"snapshot={snapshot}" / "bearing_std_deg=2"
        folder.mkdir(parents=True)
        rows = [row[1:5] for row in crossing_rows(snapshot)]
        (folder / "m.csv").write_text(plain_csv(rows, "sensor,sensor_x_m,sensor_y_m,bearing_rad"))
    outcome = cli("localize", "in", "-m", "ls", "-q")
    assert outcome.code == 0, outcome.err
    assert outcome.table.column("snapshot").to_pylist() == [10, 9]
    (tmp_path / "in" / "snapshot=9" / "bearing_std_deg=2").rename(
        tmp_path / "in" / "snapshot=9" / "bearing_std_deg=two"
    )
    refused = cli("localize", "in", "-m", "ls", "-q")
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert "bearing_std_deg=two" in refused.err


@pytest.mark.parametrize("ids", ["rising", "in no order", "coming back"])
def test_a_long_part_is_made_from_slices(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ids: str) -> None:
    """Row groups solved by an engine are joined to the bytes of a local run: results, manifest, errors."""
    table = read_parquet(GOOD)
    numbers = np.unique(table["snapshot"].to_numpy(), return_inverse=True)[1]
    shown = {"rising": numbers, "in no order": (numbers * 7) % 41, "coming back": np.where(numbers == 30, 3, numbers)}
    table = table.set_column(table.column_names.index("snapshot"), "snapshot", pa.array(shown[ids]))
    parts_of(table, tmp_path / "in", (0, 227, 240), row_group_size=8)
    made = []

    def engine(work: PartWork | SliceWork, numbers: Sequence[int]) -> Iterator[Any]:
        for number in numbers:
            made.append(work.names[number] if isinstance(work, PartWork) else "slice")
            yield work.make(number)

    monkeypatch.setattr("nlosctl.pipeline.engine.dask_engine.dask_engine", lambda scheduler, jobs, timeout_s: engine)
    monkeypatch.setenv("NLOSCTL_TASK_ROWS", "8")
    outcomes = {}
    for name, more in (("here", ()), ("there", ("--engine", "dask"))):
        outputs = ("-o", f"{name}/", "--flags-out", f"{name}_flags/")
        outcomes[name] = cli("localize", "in", "--scene", SCENE, "-m", "ls", *outputs, *more)
    assert (outcomes["there"].code, outcomes["there"].err) == (outcomes["here"].code, outcomes["here"].err)
    assert outcomes["here"].code == (1 if ids == "coming back" else 0)
    if ids != "coming back":
        assert made.count("slice") == 29
        for end in ("", "_flags"):
            assert content(tmp_path / f"there{end}") == content(tmp_path / f"here{end}")
        assert made[0] == "p1.parquet"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
