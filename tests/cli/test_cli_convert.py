"""``nlosctl convert``: arguments, errors, tables between formats."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet
import pytest
from cli_support import FIXTURES, GOOD, SCENE

from nlosctl.io.scenes.scene_file import scene_from_toml

pytestmark = pytest.mark.extensive

LOGS = FIXTURES / "formats"


def test_formats_are_listed(cli: Any) -> None:
    """Without arguments it lists importers, exporters and tables, as text and as JSON."""
    assert "kraken-csv" in cli("convert").text
    listed = cli("convert", "--list", "--json").json
    assert {"way": "export", "name": "kml"}.items() <= next(row for row in listed if row["name"] == "kml").items()
    assert {row["way"] for row in listed} == {"import", "export", "table"}


def test_show_lists_the_parameters(cli: Any) -> None:
    """Parameters of a format have type, default and meaning, with the document of the format."""
    output = cli("convert", "--from", "uwb", "--show", "--json").json
    assert output["name"] == "import.uwb"
    assert "window" in {item["name"] for item in output["parameters"]}
    assert "UBX-21004616" in cli("convert", "--from", "uudf", "--show").text
    wrong = cli("convert", "--from", "uwd", "--show")
    assert (wrong.code, wrong.out) == (2, b"")
    assert "no importer 'uwd' (did you mean 'uwb'?)" in wrong.err


@pytest.mark.parametrize("extension", ["csv", "csv.gz", "jsonl", "arrow", "arrows", "parquet"])
def test_tables_round_trip(cli: Any, tmp_path: Path, extension: str) -> None:
    """Every format has the same rows; the scene goes along, or to a file of its own."""
    there, scene, back = (str(tmp_path / name) for name in (f"a.{extension}", "a.scene.toml", "b.parquet"))
    assert cli("convert", GOOD, "-o", there, "--scene-out", scene).code == 0
    again = cli("convert", there, "-o", back)
    assert again.code == 0, again.err
    one, other = pyarrow.parquet.read_table(GOOD), pyarrow.parquet.read_table(back)
    assert scene_from_toml(other.schema.metadata[b"nlosctl.scene"].decode(), "b") == scene_from_toml(
        SCENE.read_text(encoding="utf-8"), "a"
    )
    assert other.num_rows == one.num_rows
    assert other.column("bearing_rad").to_pylist() == pytest.approx(one.column("bearing_rad").to_pylist(), abs=1e-15)
    assert other.column("sensor").to_pylist() == one.column("sensor").to_pylist()


def test_a_lost_scene_is_reported(cli: Any) -> None:
    """A scene that the format can't store is reported."""
    assert "cannot store the scene; --scene-out FILE" in cli("convert", GOOD, "-o", "a.csv").err
    assert "no room" not in cli("convert", GOOD, "-o", "a.arrow").err


def test_a_bad_line_stops_the_import_or_is_set_aside(cli: Any) -> None:
    """Line, field, value and expectation; with --bad-rows the import continues."""
    text = (LOGS / "uwb_ranges.csv").read_text(encoding="utf-8") + "1734501487,CCF9579B21AE,far,0.01\n"
    Path("log.csv").write_text(text, encoding="utf-8")
    words = ["convert", "log.csv", "--from", "uwb", "-o", "log.parquet"]
    stopped = cli(*words)
    assert (stopped.code, stopped.out) == (1, b"")
    assert "log.csv, line 8, field 'range': got 'far', expected a number from 1e-09 to 1e+15" in stopped.err
    assert not Path("log.parquet").exists()
    gone_on = cli(*words, "--bad-rows", "bad.csv")
    assert gone_on.code == 0
    assert "log.csv: 6 rows, 1 bad row set aside" in gone_on.err
    assert "1734501487,CCF9579B21AE,far,0.01" in Path("bad.csv").read_text(encoding="utf-8")


def test_a_bad_cell_of_a_table_is_set_aside_too(cli: Any) -> None:
    """A cell that is not a number is reported with row and column."""
    Path("a.csv").write_text(
        "sensor,sensor_x_m,sensor_y_m,range_m,range_std_m\na,0,0,5,1\nb,x,0,5,1\nc,0\n", encoding="utf-8"
    )
    stopped = cli("convert", "a.csv", "-o", "a.parquet")
    assert stopped.code == 1
    assert "a.csv, row 2 (line 3), column 'sensor_x_m'" in stopped.err
    assert not Path("a.parquet").exists()
    assert cli("convert", "a.csv", "-o", "a.parquet", "--bad-rows", "bad.csv").code == 0
    assert pyarrow.parquet.read_table("a.parquet").num_rows == 1
    assert len(Path("bad.csv").read_text(encoding="utf-8").splitlines()) == 3


def test_from_stdin_to_stdout(cli: Any) -> None:
    """A pipe on both sides, and a window by its own option."""
    log = (LOGS / "kraken_app.csv").read_bytes()
    outcome = cli("convert", "-", "--from", "kraken-csv", "--window", "300ms", stdin=log)
    assert outcome.code == 0, outcome.err
    starts = ["1712000000", "1712000000", "1712000000.3"]
    assert outcome.table.column("snapshot").to_pylist() == [f"frequency_hz-433920000/{start}" for start in starts]


def test_localize_writes_the_same_map(cli: Any) -> None:
    """`localize -o fixes.geojson` equals `localize | convert --to geojson`, also through CSV."""
    cli("convert", LOGS / "kraken_app.csv", "--from", "kraken-csv", "-o", "k.csv")
    table = cli("localize", "k.csv", "--bearing-std-deg", "5")
    cli("localize", "k.csv", "--bearing-std-deg", "5", "-o", "k.geojson")
    piped = cli("convert", "-", "--to", "geojson", stdin=table.out)
    assert json.loads(piped.out) == json.loads(Path("k.geojson").read_text(encoding="utf-8"))


def test_a_map_without_a_frame_is_an_error(cli: Any) -> None:
    """One line, nothing on stdout, and the option that gives a frame."""
    table = cli("localize", FIXTURES / "good_bearings.csv").out
    lost = cli("convert", "-", "--to", "kml", stdin=table)
    assert (lost.code, lost.out) == (1, b"")
    assert "no location on earth: define the plane with --origin" in lost.err
    assert cli("convert", "-", "--to", "kml", "--origin", "47,8", stdin=table).code == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.csv", "--from", "krakn-csv"], "no importer 'krakn-csv' (did you mean 'kraken-csv'?)"),
        (["a.csv", "--to", "geo-json"], "no exporter 'geo-json' (did you mean 'geojson'?)"),
        (["a.csv", "--from", "uwb", "-p", "windw=1s"], "importer 'uwb' has no parameter 'windw' (did you mean"),
        (["a.csv", "--from", "uwb", "-p", "range_unit=ft"], "The 'range_unit' parameter of importer 'uwb' must be"),
        (["a.csv", "-o", "b.parquet", "-p", "x=1"], "--param is for importers and exporters"),
        (["a.csv", "b.csv"], "convert takes one input, got 2"),
        (["--from", "uwb"], "name a file to convert"),
        (["a.csv", "--crs", "EPSG:4326"], "expected a projected one in metres"),
        (["a.csv", "--input-format", "xml"], "no format 'xml'"),
        (["a.csv", "--from", "uwb", "--input-format", "csv"], "--input-format is for tables"),
    ],
)
def test_contradicting_options(cli: Any, words: list[str], message: str) -> None:
    """Contradicting options exit 2 with one line, and nothing is written."""
    Path("a.csv").write_text("time,anchor,range\n0,a,1\n", encoding="utf-8")
    outcome = cli("convert", *words)
    assert (outcome.code, outcome.out) == (2, b"")
    assert message in outcome.err
    assert len(list(Path().iterdir())) == 1


def test_nothing_is_overwritten(cli: Any) -> None:
    """An existing output, a map too, is kept without --overwrite; the input is never the output."""
    table = cli("localize", LOGS.parent / "good_bearings.csv").out
    Path("old.kml").write_text("mine", encoding="utf-8")
    outcome = cli("convert", "-", "--to", "kml", "--origin", "47,8", "-o", "old.kml", stdin=table)
    assert outcome.code == 1
    assert "exists already" in outcome.err
    assert Path("old.kml").read_text(encoding="utf-8") == "mine"
    Path("t.csv").write_bytes(table)
    assert cli("convert", "t.csv", "-o", "t.csv", "--overwrite").code == 1


def test_a_folder_is_one_table(cli: Any, tmp_path: Path) -> None:
    """The parts of a folder are concatenated; differing columns are reported."""
    folder = tmp_path / "parts"
    folder.mkdir()
    for number in range(2):
        pyarrow.parquet.write_table(pa.table({"snapshot": [number], "sensor": ["a"]}), folder / f"{number}.parquet")
    assert cli("convert", folder, "--format", "csv").table.column("snapshot").to_pylist() == [0, 1]
    pyarrow.parquet.write_table(pa.table({"other": [1]}), folder / "2.parquet")
    assert "its columns differ from those of" in cli("convert", folder, "--format", "csv").err


def test_foreign_files_suggest_the_importers(cli: Any) -> None:
    """The message about a log without --from names the importers."""
    for name, code in (("kraken_app.csv", 1), ("df_aggregator.xml", 2)):
        outcome = cli("convert", LOGS / name, "-o", "a.parquet")
        assert (outcome.code, outcome.out) == (code, b"")
        assert "--from" in outcome.err
        assert "internal error" not in outcome.err
    wrong = cli("convert", LOGS / "kraken_app.csv", "--from", "wildlife")
    assert wrong.err == (
        f"nlosctl: {LOGS / 'kraken_app.csv'}: column '0.0' occurs twice; rename or drop one; it looks like a file for "
        "the importer 'kraken-csv': convert it by --from kraken-csv\n"
    )
