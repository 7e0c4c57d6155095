"""Convention 1: inputs, and how formats are detected."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest
from cli_support import FIXTURES, GOOD, SCENE, Outcome, crossing_rows, good_table, plain_csv, read_parquet

from nlosctl.io.paths.locations import FileFormat, format_of_bytes

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
EXTENSIONS = ["csv", "csv.gz", "parquet", "arrow", "arrows", "jsonl"]
WRITTEN = [*EXTENSIONS, "jsonl.gz"]


def whole(cli: Cli) -> Outcome:
    """Return the run on the valid Parquet file."""
    return cli("localize", GOOD, "-q")


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_the_format_follows_the_extension(cli: Cli, extension: str) -> None:
    """Every format of the same rows gives the same estimates to the byte."""
    outcome = cli("localize", FIXTURES / f"good_bearings.{extension}", "-q")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == whole(cli).out


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_the_format_of_standard_input_is_detected(cli: Cli, extension: str) -> None:
    """``-`` reads any format from a pipe."""
    content = (FIXTURES / f"good_bearings.{extension}").read_bytes()
    outcome = cli("localize", "-", "--scene", SCENE, "-q", stdin=content)
    assert outcome.code == 0, outcome.err
    assert outcome.out == whole(cli).out


def test_input_format_overrides_the_name(cli: Cli, tmp_path: Path) -> None:
    """A name without a known extension is a usage error; ``--input-format`` is the cure."""
    (tmp_path / "bearings.dat").write_bytes((FIXTURES / "good_bearings.jsonl").read_bytes())
    refused = cli("localize", "bearings.dat", "--scene", SCENE)
    assert refused.code == 2
    assert "--input-format" in refused.err
    outcome = cli("localize", "bearings.dat", "--scene", SCENE, "--input-format", "jsonl", "-q")
    assert outcome.out == whole(cli).out


def test_input_format_overrides_the_first_bytes(cli: Cli) -> None:
    """JSON Lines that begin like CSV are read if the format is given."""
    content = b"\n" + (FIXTURES / "good_bearings.csv").read_bytes()
    assert cli("localize", "-", "--scene", SCENE, "--input-format", "jsonl", stdin=content).code == 1
    import gzip

    packed = gzip.compress((FIXTURES / "good_bearings.jsonl").read_bytes())
    outcome = cli("localize", "-", "--scene", SCENE, "--input-format", "jsonl.gz", "-q", stdin=packed)
    assert outcome.out == whole(cli).out


@pytest.mark.parametrize("extension", WRITTEN)
def test_the_output_format_follows_the_extension(cli: Cli, tmp_path: Path, extension: str) -> None:
    """``-o x.EXT`` writes EXT, which reads back to the same measurements."""
    assert cli("simulate", "ring", "-n", 3, "-o", f"x.{extension}", "-q").code == 0
    found = format_of_bytes((tmp_path / f"x.{extension}").read_bytes()[:16])
    expected = FileFormat(extension)
    assert found == {FileFormat.JSON_LINES_GZ: FileFormat.CSV_GZ}.get(expected, expected)
    assert cli("localize", f"x.{extension}", "-q").out == cli("localize", f"x.{extension}", "-q", "--seed", 1).out
    rows = cli("localize", f"x.{extension}", "-q").table
    assert rows.column("status").to_pylist() == ["ok"] * 3


def test_the_output_format_overrides_the_extension(cli: Cli, tmp_path: Path) -> None:
    """``--format`` sets the output format for any name."""
    assert cli("simulate", "ring", "-n", 3, "-o", "x.dat").code == 2
    assert cli("simulate", "ring", "-n", 3, "-o", "x.dat", "--format", "parquet", "-q").code == 0
    assert pyarrow.parquet.read_table(tmp_path / "x.dat").num_rows == 24


def test_a_pipe_gets_csv(cli: Cli) -> None:
    """Without ``-o`` and ``--format`` a pipe gets CSV with a header."""
    outcome = cli("simulate", "ring", "-n", 2, "-q")
    lines = outcome.text.splitlines()
    assert lines[0].startswith("snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,truth_x_m")
    assert len(lines) == 17


def test_arrow_in_a_pipe_carries_types_and_scene(cli: Cli) -> None:
    """``--format arrow`` on stdout has the scene in its metadata; CSV can't store it."""
    stream = cli("simulate", "song-flat", "-n", 5, "--format", "arrow", "-q").out
    with pa.ipc.open_stream(io.BytesIO(stream)) as reader:
        assert b"nlosctl.scene" in reader.schema.metadata
        assert reader.schema.field("snapshot").type == pa.int64()
        assert reader.schema.field("bearing_rad").type == pa.float64()
        assert reader.schema.field("truth_los").type == pa.bool_()
    solved = cli("localize", "-", "--format", "arrow", "-q", stdin=stream)
    with pa.ipc.open_stream(io.BytesIO(solved.out)) as reader:
        assert b"nlosctl.scene" in reader.schema.metadata
        assert reader.read_all().column("status").to_pylist() == ["ok"] * 5
    lost = cli("localize", "-", stdin=cli("simulate", "song-flat", "-n", 5, "-q").out)
    assert lost.code == 1
    assert "reflector" in lost.err


def split_good(folder: Path, cut: int) -> None:
    """Write the valid rows as two files of a folder, the first with ``cut`` rows."""
    lines = (FIXTURES / "good_bearings.csv").read_text().splitlines(keepends=True)
    header, rows = lines[0], lines[1:]
    assert rows[cut - 1].split(",")[0] == rows[cut].split(",")[0], "the cut must be within a snapshot"
    folder.mkdir()
    (folder / "part-0.csv").write_text(header + "".join(rows[:cut]))
    (folder / "part-1.csv").write_text(header + "".join(rows[cut:]))


@pytest.mark.process
def test_parts_of_a_folder_are_one_table(cli: Cli, tmp_path: Path) -> None:
    """A snapshot across two parts of a folder is one snapshot; there is no ``source``."""
    split_good(tmp_path / "parts", 101)
    (tmp_path / "parts" / "_SUCCESS").write_text("")
    (tmp_path / "parts" / "README.md").write_text("not a table")
    outcome = cli("localize", "parts", "--scene", SCENE, "-q")
    assert outcome.code == 0, outcome.err
    assert outcome.out == whole(cli).out


@pytest.mark.process
def test_parts_of_a_folder_may_differ_in_format(cli: Cli, tmp_path: Path) -> None:
    """Parts in different formats are still one table, in the order of their names."""
    split_good(tmp_path / "parts", 101)
    table = good_table()
    (tmp_path / "parts" / "part-1.csv").unlink()
    pa.parquet.write_table(table.slice(101), tmp_path / "parts" / "part-1.parquet")
    outcome = cli("localize", "parts", "--scene", SCENE, "-q")
    assert outcome.code == 0, outcome.err
    assert outcome.out == whole(cli).out


@pytest.mark.process
@pytest.mark.parametrize("words", [["a.csv", "b.csv"], ["?.csv"]], ids=["named", "glob"])
def test_several_files_are_kept_apart(cli: Cli, tmp_path: Path, words: list[str]) -> None:
    """Equal snapshot ids in several files or a glob are separate; ``source`` names the file."""
    for name, count in (("a.csv", 3), ("b.csv", 4)):
        rows = [*crossing_rows("x", count), *crossing_rows("y", count)]
        (tmp_path / name).write_text(plain_csv(rows))
    outcome = cli("localize", *words, "-o", "e.parquet", "--flags-out", "f.parquet")
    assert outcome.code == 0, outcome.err
    estimates, flags = read_parquet(tmp_path / "e.parquet"), read_parquet(tmp_path / "f.parquet")
    assert estimates.column("source").to_pylist() == ["a.csv", "a.csv", "b.csv", "b.csv"]
    assert estimates.column("snapshot").to_pylist() == ["x", "y", "x", "y"]
    assert estimates.column("n_measurements").to_pylist() == [3, 3, 4, 4]
    assert flags.column("source").to_pylist() == ["a.csv"] * 6 + ["b.csv"] * 8


def test_one_file_gets_no_source(cli: Cli, tmp_path: Path) -> None:
    """With one input there is no ``source`` column."""
    (tmp_path / "a.csv").write_text(plain_csv(crossing_rows(1)))
    assert "source" not in cli("localize", "a.csv", "-q").table.column_names


def test_files_keep_their_own_scenes(cli: Cli, tmp_path: Path) -> None:
    """Each named file is solved in the scene beside it, or the run is refused."""
    mirrored = plain_csv(
        [(*row, "wall") for row in crossing_rows(1)],
        "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,reflector",
    )
    alone = []
    for name, height in (("a", 2.0), ("b", 2.5)):
        (tmp_path / f"{name}.csv").write_text(mirrored)
        scene = f'[[reflector]]\nname="wall"\nkind="line"\npoint=[0.0, {height}]\ndirection=[1.0, 0.0]\n'
        (tmp_path / f"{name}.scene.toml").write_text(scene)
        alone += cli("localize", f"{name}.csv", "-q").table.column("y_m").to_pylist()
    assert alone == pytest.approx([1.0, 2.0], abs=0.1)
    both = cli("localize", "a.csv", "b.csv", "-q")
    if both.code == 0:
        assert both.table.column("y_m").to_pylist() == alone
    else:
        assert "scene" in both.err


@pytest.mark.parametrize("name", [".", "./", "./."])
@pytest.mark.parametrize("command", ["localize", "validate"])
def test_the_current_folder_is_an_input(cli: Cli, tmp_path: Path, command: str, name: str) -> None:
    """A folder without a name in its path is read like any other, with its scene."""
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.csv").write_text(plain_csv(crossing_rows(1)))
    with contextlib.chdir(tmp_path / "in"):
        outcome = cli(command, name, "-q")
    assert outcome.code == 0, outcome.err


def test_a_name_of_the_longest_length_is_read(cli: Cli, tmp_path: Path) -> None:
    """The longer name of a scene beside it, which no file system allows, is not looked for."""
    name = "a" * 251 + ".csv"
    (tmp_path / name).write_text(plain_csv(crossing_rows(1)))
    assert cli("localize", name, "-q").code == 0


def test_the_scene_option_beats_the_others(cli: Cli, tmp_path: Path) -> None:
    """``--scene FILE`` overrides the scene in the table, which overrides the one beside the file."""
    assert cli("simulate", "song-flat", "-n", 4, "-o", "m.parquet", "--scene-out", "own.toml", "-q").code == 0
    (tmp_path / "m.scene.toml").write_text("not TOML at all")
    carried = cli("localize", "m.parquet", "-q")
    assert carried.code == 0, carried.err
    assert cli("localize", "m.parquet", "--scene", "own.toml", "-q").out == carried.out
    refused = cli("localize", "m.parquet", "--scene", "m.scene.toml")
    assert refused.code == 1
    assert "m.scene.toml" in refused.err


def test_extensions_override_format(cli: Cli, tmp_path: Path) -> None:
    """``--format`` is for outputs without an extension; the flags beside a stream follow theirs."""
    assert cli("localize", GOOD, "-q", "--format", "arrow", "--flags-out", "f.parquet").code == 0
    assert (tmp_path / "f.parquet").read_bytes()[:4] == b"PAR1"
