"""``nlosctl track`` from estimates and from measurements: columns, order, statuses, the same bytes, messages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]

HEAD = "snapshot,tag,time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2"


def write_fixes(folder: Path, head: str = HEAD, rows: int = 40) -> None:
    """Two interleaved tags, not in order of time, one of them with a gap and a row without a position."""
    rng = np.random.default_rng(1)
    lines = []
    for k in rng.permutation(rows):
        tag, second = "ab"[k % 2], float(k // 2) + (100.0 if k > rows // 2 and k % 2 else 0.0)
        place = ",,,," if k == 6 else f"{second + rng.normal():.3f},{rng.normal():.3f},1,0.1,1"
        lines.append(f"s{k},{tag},{second},{place}")
    (folder / "fixes.csv").write_text("\n".join([head, *lines, ""]))


def test_a_row_for_each_snapshot_in_the_order_of_the_file(cli: Cli, tmp_path: Path) -> None:
    """Ids, ``--by`` columns and times are kept, velocities and the part stand beside them."""
    write_fixes(tmp_path)
    outcome = cli("track", "fixes.csv", "--by", "tag", "--gap", "60s", "-p", "acceleration_psd=0.1", "-o", "t.parquet")
    assert outcome.code == 0
    assert "2 tracks, 3 parts by gaps; acceleration_psd 0.1 m2/s3, as given" in outcome.err
    assert "1 snapshot without a position and a positive definite covariance" in outcome.err
    given, found = pc.read_csv(tmp_path / "fixes.csv"), pq.read_table(tmp_path / "t.parquet")
    for name in ("snapshot", "tag", "time_s"):
        assert found.column(name).to_pylist() == given.column(name).to_pylist()
    assert set(found.column("status").to_pylist()) == {"ok"}
    assert set(found.column("covariance_kind").to_pylist()) == {"smoothed"}
    assert {"vx_m_s", "cov_vxvy_m2_s2", "cov_vyvy_m2_s2"} <= set(found.column_names)
    assert set(found.column("part").to_pylist()) == {0, 1}
    assert found.column("n_used").to_pylist().count(0) == 1


def test_times_as_text_and_standard_input_give_the_same_path(cli: Cli, tmp_path: Path) -> None:
    """ISO times are times; a stream is read as a file is."""
    write_fixes(tmp_path)
    words = ("--by", "tag", "-p", "acceleration_psd=0.1", "-q")
    expected = cli("track", "fixes.csv", *words)
    text = (tmp_path / "fixes.csv").read_text()
    assert cli("track", "-", *words, stdin=text.encode()).out == expected.out
    lines = [line.split(",") for line in text.replace("time_s", "time").splitlines()]
    for cells in lines[1:]:
        second = int(float(cells[2]))
        cells[2] = f"2026-01-01T00:{second // 60:02d}:{second % 60:02d}Z"
    (tmp_path / "iso.csv").write_text("\n".join(",".join(cells) for cells in lines) + "\n")
    iso = cli("track", "iso.csv", *words)
    names = expected.text.splitlines()[0].split(",")
    at = names.index("time_s")
    without_time = [[c for i, c in enumerate(r.split(",")) if i != at] for r in expected.text.splitlines()]
    assert [[c for i, c in enumerate(r.split(",")) if i != at] for r in iso.text.splitlines()] == without_time
    assert float(iso.text.splitlines()[1].split(",")[at]) > 1.7e9


def test_the_first_filtered_state_has_no_velocity(cli: Cli, tmp_path: Path) -> None:
    """``--causal`` gives null, not 0, where nothing is known of the velocity."""
    (tmp_path / "f.csv").write_text("time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2\n0,1,2,1,0,1\n1,2,2,1,0,1\n")
    assert cli("track", "f.csv", "-p", "acceleration_psd=1", "--causal", "-o", "t.parquet").code == 0
    rows = pq.read_table(tmp_path / "t.parquet").to_pylist()
    assert [row["vx_m_s"] is None for row in rows] == [True, False]
    assert (rows[0]["x_m"], rows[0]["cov_xx_m2"], rows[0]["status"]) == (1.0, 1.0, "ok")
    assert rows[1]["covariance_kind"] == "filtered"


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ([], 2, "--param acceleration_psd or --estimate-acceleration is needed"),
        (
            ["-p", "acceleration_psd=0"],
            2,
            "larger than 0 (m2/s3); a small one is nearly a constant velocity. Got 0 instead.",
        ),
        (["-p", "acceleration_psd=-1"], 2, "larger than 0 (m2/s3)"),
        (["-p", "acceleration_psd=1", "--estimate-acceleration"], 2, "both set it; give one"),
        (["-p", "acceleration_psd=1", "-p", "alpha=0.1"], 2, "a track through estimates has no method"),
        (["-p", "acceleration_psd=1", "--gap", "60"], 2, "--gap must be a width larger than 0 with its unit"),
        (["-p", "acceleration_psd=1", "--gap", "auto"], 2, "--gap must be a time with its unit"),
        (["-p", "acceleration_psd=1", "--window", "2s"], 2, "the input is estimates"),
        (
            ["-p", "acceleration_psd=1", "--calibration", "c.toml"],
            2,
            "--calibration corrects measurements, and the input",
        ),
        (["-p", "acceleration_psd=1", "--by", "tga"], 1, "no column 'tga' (did you mean 'tag'?)"),
        (["-p", "acceleration_psd=1", "--max-sort-rows", "5"], 1, "more than 5 rows, which a track needs in memory"),
        (["-p", "acceleration_psd=1", "-o", "out/"], 2, "a track through estimates is written to a file"),
        (["-p", "acceleration_psd=1", "--flags-out", "f.csv"], 2, "flags are of measurements"),
    ],
)
def test_messages(cli: Cli, tmp_path: Path, words: list[str], code: int, message: str) -> None:
    """Each fault is one clear line with the right exit code."""
    write_fixes(tmp_path)
    outcome = cli("track", "fixes.csv", *words)
    assert outcome.code == code
    assert message in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1


def test_faults_of_the_table(cli: Cli, tmp_path: Path) -> None:
    """No times, a time that can't be read, several methods in a track: one line with the cure."""
    write_fixes(tmp_path, HEAD.replace("time_s", "second"))
    err = cli("track", "fixes.csv", "-p", "acceleration_psd=1").err
    assert "no column 'time_s' or 'time'" in err
    assert "localize the measurements again with --carry time_s (or time)" in err
    head = "method,time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2"
    (tmp_path / "m.csv").write_text(f"{head}\nml,0,1,2,1,0,1\nls,1,2,2,1,0,1\n")
    err = cli("track", "m.csv", "-p", "acceleration_psd=1").err
    assert "a track of several methods (ml, ls); add method to --by" in err
    assert cli("track", "m.csv", "-p", "acceleration_psd=1", "--by", "method", "-o", "m.parquet").code == 0
    (tmp_path / "n.csv").write_text(f"{head}\nml,,1,2,1,0,1\nml,1,2,2,1,0,1\n")
    assert "n.csv, row 1, column 'time_s'" in cli("track", "n.csv", "-p", "acceleration_psd=1").err


ANCHORS = ((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0))


def write_ranges(folder: Path, name: str = "ranges.csv", *, snapshot: bool = False) -> None:
    """Ranges of two tags, one after the other, some of them bad or flagged by an earlier step."""
    rng = np.random.default_rng(2)
    lines = ["snapshot," * snapshot + "time_s,tag,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m,truth_x_m,truth_y_m"]
    for k in range(240):
        second, tag, (x, y) = 0.05 * k, k % 2, ANCHORS[k // 2 % 4]
        place = 10.0 + 1.2 * second + 8.0 * tag, 12.0 - 0.5 * second + 4.0 * tag
        length = np.hypot(place[0] - x, place[1] - y) + 0.2 * rng.normal() + (9.0 if k % 17 == 5 else 0.0)
        head = f"{k // 8}," if snapshot else ""
        lines.append(f"{head}{second:.2f},t{tag},A{k // 2 % 4},{x},{y},{length:.4f},0.2,{place[0]},{place[1]}")
    (folder / name).write_text("\n".join([*lines, ""]))


WINDOWS = ("--window", "0.4s", "--by", "tag", "-m", "mixture-ml", "-p", "acceleration_psd=0.05")


def test_measurements_in_windows_give_a_state_for_each(cli: Cli, tmp_path: Path) -> None:
    """Rows of two tags become two tracks, with flags in the order of the file and the truth at the mean time."""
    write_ranges(tmp_path)
    outcome = cli("track", "ranges.csv", *WINDOWS, "-o", "t.parquet", "--flags-out", "f.parquet")
    assert outcome.code == 0
    assert "60 snapshots of ranges, 240 rows" in outcome.err
    assert "2 tracks; acceleration_psd 0.05 m2/s3, as given" in outcome.err
    found, flags = pq.read_table(tmp_path / "t.parquet"), pq.read_table(tmp_path / "f.parquet")
    rows = found.to_pylist()
    assert {row["snapshot"].split("/")[0] for row in rows} == {"tag-t0", "tag-t1"}
    off = [np.hypot(row["x_m"] - row["truth_x_m"], row["y_m"] - row["truth_y_m"]) for row in rows]
    assert np.sqrt(np.mean(np.square(off))) < 0.15
    assert np.mean([row["vx_m_s"] for row in rows]) == pytest.approx(1.2, abs=0.1)
    assert flags.column("time_s").to_pylist() == pc.read_csv(tmp_path / "ranges.csv").column("time_s").to_pylist()
    late = [flags.column("los")[k].as_py() for k in range(240) if k % 17 == 5]
    assert late == [False] * len(late)
    score = cli("evaluate", "t.parquet", "--fail-if", "rmse_m>0.15")
    assert score.code == 0


def test_the_bytes_do_not_depend_on_jobs_blocks_or_the_cut(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jobs, block and chunk sizes and standard input give the same bytes; the other tag changes nothing."""
    write_ranges(tmp_path)
    expected = cli("track", "ranges.csv", *WINDOWS, "-q").out
    text = (tmp_path / "ranges.csv").read_bytes()
    for words in (["--jobs", "1"], ["--jobs", "2"], ["--block-size", "7"]):
        assert cli("track", "ranges.csv", *WINDOWS, "-q", *words).out == expected
    assert cli("track", "-", *WINDOWS, "-q", stdin=text).out == expected
    monkeypatch.setenv("NLOSCTL_CHUNK_ROWS", "50")
    assert cli("track", "ranges.csv", *WINDOWS, "-q", "--jobs", "2").out == expected
    monkeypatch.delenv("NLOSCTL_CHUNK_ROWS")
    entry = '[[sensor]]\nname = "A{}"\nrange_offset_m = 0.1\nrange_offset_std_m = 0.2\n'
    (tmp_path / "offsets.toml").write_text("".join(entry.format(number) for number in range(4)))
    calibrated = cli("track", "ranges.csv", *WINDOWS, "-q", "--calibration", "offsets.toml").out
    assert calibrated != expected
    assert (
        cli("track", "ranges.csv", *WINDOWS, "-q", "--calibration", "offsets.toml", "--block-size", "7").out
        == calibrated
    )
    one = cli("track", "ranges.csv", *WINDOWS, "-q", "--where", "tag == t1").text.splitlines()
    assert one == [line for line in expected.decode().splitlines() if not line.startswith("tag-t0")]


@pytest.mark.parametrize("windows", [True, False])
def test_folders_have_a_part_file_for_each_of_the_input(cli: Cli, tmp_path: Path, windows: bool) -> None:
    """Parts together are the table of one file, a track continues from part to part, and a lost part is made again."""
    write_ranges(tmp_path, snapshot=not windows)
    head, *lines = (tmp_path / "ranges.csv").read_text().splitlines()
    (tmp_path / "in").mkdir()
    for number, part in enumerate((lines[:90], lines[90:93], lines[93:])):
        (tmp_path / "in" / f"p{number}.csv").write_text("\n".join([head, *part, ""]))
    words = WINDOWS if windows else WINDOWS[4:]
    assert cli("track", "in", *words, "-o", "one.parquet", "--flags-out", "rows.parquet").code == 0
    assert cli("track", "in", *words, "-o", "out/", "--flags-out", "flags/", "--jobs", "2").code == 0
    tables = {"one.parquet": "out", "rows.parquet": "flags"}
    assert sorted(path.name for path in (tmp_path / "out").glob("p*")) == ["p0.parquet", "p1.parquet", "p2.parquet"]
    before = (tmp_path / "out" / "p2.parquet").read_bytes()
    (tmp_path / "out" / "p2.parquet").unlink()
    outcome = cli("track", "in", *words, "-o", "out/", "--flags-out", "flags/", "--resume")
    assert outcome.code == 0
    assert "240 rows" in outcome.err
    assert (tmp_path / "out" / "p2.parquet").read_bytes() == before
    for one, folder in tables.items():
        key = "snapshot" if folder == "out" else "time_s"
        whole, parts = (pq.read_table(tmp_path / name).sort_by(key) for name in (one, folder))
        assert parts.equals(whole)


def test_folders_need_measurements_in_files(cli: Cli, tmp_path: Path) -> None:
    """A stream has no parts; --resume needs a folder; bad rows go to a folder of their own, each once."""
    write_ranges(tmp_path)
    text = (tmp_path / "ranges.csv").read_bytes()
    err = cli("track", "-", *WINDOWS, "-o", "out/", stdin=text).err
    assert "standard input has no parts: set --output to a file" in err
    assert "--resume continues a run into a folder" in cli("track", "ranges.csv", *WINDOWS, "--resume").err
    (tmp_path / "ranges.csv").write_bytes(text.replace(b"0.2,", b"-1,", 1))
    words = ("-o", "out/", "--bad-rows", "bad/")
    outcome = cli("track", "ranges.csv", *WINDOWS, *words)
    assert outcome.code == 0, outcome.err
    assert "1 bad row set aside" in outcome.err
    assert pq.read_table(tmp_path / "bad").num_rows == 1


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["-m", "sr-ls"], 2, "sr-ls can't track ranges; ml and mixture-ml of bearings, ranges and arrivals can"),
        (["-m", "ml", "-m", "mixture-ml"], 2, "--method: a track is found by one method. Got 2."),
        (["-m", "mixture-ml", "-p", "alpha=estimate"], 2, "alpha=estimate: set a number to track with"),
        (["--by", "tga"], 1, "no column 'tga' (did you mean 'tag'?)"),
        (
            ["--associate"],
            2,
            "find those first, by identify-los with --estimates-out, and with --carry time_s where no",
        ),
        (["--by", "tag"], 1, "rows of several tracks by tag (t0, t1)"),
        (["--window", "2s"], 1, "has a column 'snapshot', so that --window cannot make snapshots"),
        (["--max-sort-rows", "99"], 1, "more than 99 rows, which a track needs in memory"),
    ],
)
def test_messages_on_measurements(cli: Cli, tmp_path: Path, words: list[str], code: int, message: str) -> None:
    """Each fault is one clear line with the right exit code."""
    write_ranges(tmp_path, snapshot=True)
    outcome = cli("track", "ranges.csv", "-p", "acceleration_psd=1", *words)
    assert (outcome.code, len(outcome.err.strip().splitlines())) == (code, 1)
    assert message in outcome.err


def test_measurements_without_times_name_both_kinds_of_input(cli: Cli, tmp_path: Path) -> None:
    """Without a column of times the message names times, measurements and estimates."""
    write_ranges(tmp_path, snapshot=True)
    text = (tmp_path / "ranges.csv").read_text()
    (tmp_path / "ranges.csv").write_text(text.replace("time_s", "second"))
    err = cli("track", "ranges.csv", "-p", "acceleration_psd=1").err
    assert "no column 'time_s' or 'time'" in err
    assert "tracks, of measurements or of estimates (x_m, y_m, cov_xx_m2, ...), need" in err


TARGETS = "snapshot,target,time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,status"


def test_targets_of_snapshots_become_tracks(cli: Cli, tmp_path: Path) -> None:
    """With ``--associate`` targets numbered snapshot by snapshot are one track each; a row without one has none."""
    rng = np.random.default_rng(3)
    lines = []
    for second in range(20):
        places = [(2.0 * second, 0.0), (100.0 - second, 50.0)]
        for number, at in enumerate(rng.permutation(2)):
            x, y = places[at] + rng.normal(0.0, 0.5, 2)
            lines.append(f"{second},{number},{second},{x:.3f},{y:.3f},0.25,0,0.25,ok")
    lines.append("20,0,20,,,,,,no_target")
    (tmp_path / "targets.csv").write_text("\n".join([TARGETS, *lines, ""]))
    words = ["-p", "acceleration_psd=0.01", "-o", "t.parquet"]
    assert "several targets" in cli("track", "targets.csv", *words).err
    outcome = cli("track", "targets.csv", "--associate", *words)
    assert outcome.code == 0
    assert "2 tracks" in outcome.err
    table = pq.read_table(tmp_path / "t.parquet").to_pylist()
    assert table[-1]["track"] is None
    assert table[-1]["status"] == "no_target"
    sides = {(row["track"], row["y_m"] > 25.0) for row in table[:-1]}
    assert len(sides) == 2
    assert {row["status"] for row in table[:-1]} == {"ok"}


def test_what_association_needs(cli: Cli, tmp_path: Path) -> None:
    """``--associate`` needs a density to predict with; its parameters are checked, and only known with it."""
    write_fixes(tmp_path)
    words = ["track", "fixes.csv", "--by", "tag"]
    needs = cli(*words, "--associate", "--estimate-acceleration")
    assert (needs.code, "acceleration_psd" in needs.err) == (2, True)
    wrong = cli(*words, "--associate", "-p", "acceleration_psd=1", "-p", "misses=0")
    assert (wrong.code, "misses" in wrong.err) == (2, True)
    alone = cli(*words, "-p", "acceleration_psd=1", "-p", "misses=3")
    assert (alone.code, "misses" in alone.err) == (2, True)
